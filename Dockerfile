FROM python:3.11-slim
WORKDIR /opt/turnscan
COPY pyproject.toml README.md LICENSE ./
COPY app app
RUN pip install --no-cache-dir '.[fast]' && useradd --create-home turnscan
USER turnscan
WORKDIR /data
VOLUME /data
ENTRYPOINT ["turnscan"]
CMD ["--help"]
