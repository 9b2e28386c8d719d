# Build:  docker build -t turnscan .
# Try:    docker run --rm -it -p 8000:8000 -v turnscan:/data turnscan serve --bench simulated
# The scanner's devices are handed in one by one, see docs/server.md.

# The wheel, with the pages in it: the build fetches Node where it needs it, and leaves it here.
FROM python:3.11-slim AS build
WORKDIR /src
COPY pyproject.toml hatch_build.py README.md LICENSE ./
COPY web web
COPY app app
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.11-slim
COPY --from=build /wheels /wheels
RUN pip install --no-cache-dir "$(ls /wheels/*.whl)[fast,mdns]"
# Cameras belong to the group video, boards to dialout.
RUN useradd --create-home --groups video,dialout turnscan && mkdir /data && chown turnscan /data
USER turnscan
WORKDIR /data
VOLUME /data
# Announcing a name does not reach the network from inside a container. Compiled kernels stay in the volume.
ENV TURNSCAN_HOST=0.0.0.0 TURNSCAN_PORT=8000 TURNSCAN_FOLDER=/data TURNSCAN_MDNS=no NUMBA_CACHE_DIR=/data/.cache/numba
EXPOSE 8000
HEALTHCHECK --interval=30s --timeout=6s --start-period=20s CMD ["python", "-m", "app.serving.health"]
STOPSIGNAL SIGTERM
ENTRYPOINT ["turnscan"]
CMD ["serve"]
