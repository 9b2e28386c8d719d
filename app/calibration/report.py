"""The calibration as a person reads it: sentences for the terminal, pictures for a file."""

import base64
import html
import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.calibration.outcome import CalibrationOutcome, ViewResidual
from app.calibration.projection import CAMERA_NAMES
from app.errors import OptionError
from app.files import write_whole
from app.geometry.arrays import Floats

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_LONGEST_ARROW = 0.03


def report_lines(outcome: CalibrationOutcome) -> list[str]:
    """The result in plain lines, most important first."""
    record = outcome.record
    camera = record.camera
    values = camera.matrix[0, 0], camera.matrix[1, 1], camera.matrix[0, 2], camera.matrix[1, 2]
    sigmas = outcome.camera_sigma[:4]
    with_sigma = [
        f"{v:.1f} ± {s:.1f}" if s > 0.0 else f"{v:.1f}" for v, s in zip(values, sigmas, strict=True)
    ]
    lines = [
        f"Method           {record.method}",
        "Camera           fx {}, fy {}, centre ({}, {}) px".format(*with_sigma),
        f"Reprojection     {record.rms_px:.3f} px RMS",
        "Distortion       " + ", ".join(_term(outcome, k) for k in range(4, 9)),
        f"Coverage         the board reached {100.0 * outcome.coverage.share:.0f} % of the picture",
    ]
    for name, plane in record.lasers.items():
        rms = record.laser_rms_mm.get(name, float("nan"))
        normal = ", ".join(f"{c:.5f}" for c in plane.normal)
        lines.append(f"Laser {name:<10} ({normal}) . X = {plane.distance_mm:.3f} mm, {rms:.3f} mm RMS")
    if record.axis is not None:
        direction = ", ".join(f"{c:.5f}" for c in record.axis.direction)
        lines.append(
            f"Axis             direction ({direction}) by {outcome.axis_method}, "
            f"{record.axis_rms_mm:.3f} mm RMS"
        )
        height = record.axis.offset_mm
        lines.append(
            f"Table            {height:.2f} mm along the axis from its point"
            if np.isfinite(height)
            else "Table            height unknown: heights count from the axis point nearest the camera"
        )
        errors = _angle_errors(outcome)
        if len(errors):
            lines.append(
                f"Table angle      {np.sqrt(np.mean(errors**2)):.2f} degrees RMS from what was commanded, "
                f"{np.abs(errors).max():.2f} at most"
            )
    if np.isfinite(outcome.chi):
        lines.append(f"Chi              {outcome.chi:.2f} (1 where model and assumed noise are right)")
        noise = ", ".join(f"{name} {value:.2f} px" for name, value in outcome.noise_px.items())
        lines.append(f"Noise            {noise}")
    if np.isfinite(record.expected_error_mm):
        lines.append(
            f"Expected error   {record.expected_error_mm:.3f} mm at the surface of an object of 100 mm, "
            "from calibration alone"
        )
    lines += [f"Left out         {name}: {reason}" for name, reason in outcome.dropped[:12]]
    if len(outcome.dropped) > 12:
        lines.append(f"Left out         and {len(outcome.dropped) - 12} more")
    return lines


def check_report_name(path: Path) -> None:
    """Complain about a name that ends neither in .png nor in .html.

    Raises:
        OptionError: it does.
    """
    if path.suffix.lower() not in (".png", ".html", ".htm"):
        raise OptionError(f"{path}: a report is a .png or an .html file.", "Choose one of these endings.")


def write_report(outcome: CalibrationOutcome, path: Path) -> None:
    """A picture (.png) or a page (.html) with residuals, coverage, stripes and the table's wobble.

    Raises:
        OptionError: the name ends otherwise.
        OutputError: it cannot be written.
    """
    check_report_name(path)
    picture = _picture(outcome)
    write_whole(path, picture if path.suffix.lower() == ".png" else _page(outcome, picture))


def _term(outcome: CalibrationOutcome, k: int) -> str:
    value, sigma = float(outcome.record.camera.distortion[k - 4]), float(outcome.camera_sigma[k])
    if sigma == 0.0:
        return f"{CAMERA_NAMES[k]} {value:.4f}" if value else f"{CAMERA_NAMES[k]} not used"
    doubt = "" if abs(value) > 2.0 * sigma else " (not significant)"
    return f"{CAMERA_NAMES[k]} {value:.4f} ± {sigma:.4f}{doubt}"


def _angle_errors(outcome: CalibrationOutcome) -> Floats:
    errors = (view.angle_error_deg for view in outcome.views)
    return np.array([error for error in errors if np.isfinite(error)])


def _picture(outcome: CalibrationOutcome) -> bytes:
    # Half a second, which the server's start can do without.
    from matplotlib.figure import Figure

    figure = Figure(figsize=(14.0, 8.4), layout="constrained")
    places = figure.subplots(2, 3)
    record = outcome.record
    expected = record.expected_error_mm
    figure.suptitle(
        f"Calibration, {record.created:%Y-%m-%d %H:%M} UTC, method {record.method}"
        + (f": {expected:.3f} mm expected at the object" if np.isfinite(expected) else ""),
        fontsize=13,
    )
    _draw_residual_field(places[0, 0], outcome)
    _draw_residual_cloud(places[0, 1], outcome)
    _draw_coverage(places[0, 2], outcome)
    _draw_views(places[1, 0], outcome)
    _draw_stripes(places[1, 1], outcome)
    _draw_wobble(places[1, 2], outcome)
    for ax in places.flat:
        ax.spines[["top", "right"]].set_visible(False)
    out = io.BytesIO()
    figure.savefig(out, format="png", dpi=110)
    return out.getvalue()


def _draw_residual_field(ax: "Axes", outcome: CalibrationOutcome) -> None:
    width, height = outcome.record.camera.size
    corners, residuals = outcome.corner_pixels, outcome.corner_residuals
    if len(corners):
        longest = float(np.percentile(np.linalg.norm(residuals, axis=1), 95.0))
        enlarged = _round_number(_LONGEST_ARROW * width / max(longest, 1e-6))
        ax.set_title(f"Corner residuals, {enlarged:.0f} times enlarged")
        off = enlarged * residuals
        ax.quiver(
            corners[:, 0], corners[:, 1], off[:, 0], off[:, 1],
            angles="xy", scale_units="xy", scale=1.0, width=0.0015, color="#1f6f8b",
        )  # fmt: skip
    ax.set(xlim=(0, width), ylim=(height, 0), aspect="equal", xlabel="u, px", ylabel="v, px")


def _round_number(value: float) -> float:
    """The largest of 1, 2, 5, 10, 20, ... that is not above a value."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= value))


def _draw_residual_cloud(ax: "Axes", outcome: CalibrationOutcome) -> None:
    ax.set_title("Corner residuals")
    residuals = outcome.corner_residuals
    reach = 4.0 * float(np.sqrt(np.mean(residuals**2))) if len(residuals) else 1.0
    ax.plot(residuals[:, 0], residuals[:, 1], ".", markersize=2.0, alpha=0.5, color="#1f6f8b")
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal", xlabel="du, px", ylabel="dv, px")
    ax.locator_params(nbins=5)
    ax.grid(alpha=0.3)


def _draw_coverage(ax: "Axes", outcome: CalibrationOutcome) -> None:
    width, height = outcome.record.camera.size
    ax.set_title(f"Corners seen per field ({100.0 * outcome.coverage.share:.0f} % reached)")
    counts = outcome.coverage.counts.astype(float)
    image = ax.imshow(
        np.where(counts > 0, counts, np.nan), extent=(0, width, height, 0), cmap="viridis", vmin=0
    )
    ax.figure.colorbar(image, ax=ax, shrink=0.7)
    ax.set_facecolor("#dddddd")
    ax.set(xlabel="u, px", ylabel="v, px")


def _draw_views(ax: "Axes", outcome: CalibrationOutcome) -> None:
    ax.set_title("Corners, RMS of each view")
    for role in dict.fromkeys(view.role for view in outcome.views):
        mine = [(k, v.corner_px) for k, v in enumerate(outcome.views) if v.role is role]
        ax.plot(*zip(*mine, strict=True), ".", label=role.value.replace("_", " "))
    ax.set(xlabel="view", ylabel="px")
    ax.set_ylim(bottom=0.0)
    _legend(ax)


def _draw_stripes(ax: "Axes", outcome: CalibrationOutcome) -> None:
    ax.set_title("Stripe to laser plane, RMS of each view on a board")
    for name in outcome.record.lasers:
        mine = [(k, v.stripe_mm[name]) for k, v in enumerate(outcome.views) if _has_board_stripe(v, name)]
        if mine:
            ax.plot(*zip(*mine, strict=True), ".", label=f"laser {name}")
    ax.set(xlabel="view", ylabel="mm")
    ax.set_ylim(bottom=0.0)
    _legend(ax)


def _has_board_stripe(view: ViewResidual, laser: str) -> bool:
    return laser in view.stripe_mm and np.isfinite(view.corner_px) and view.role.value != "scan"


def _draw_wobble(ax: "Axes", outcome: CalibrationOutcome) -> None:
    ax.set_title("Table: solved minus commanded angle")
    turned = [v for v in outcome.views if np.isfinite(v.angle_error_deg)]
    if turned:
        commanded = [v.commanded_deg for v in turned]
        ax.plot(commanded, [v.angle_error_deg for v in turned], ".", color="#c44e52")
    else:
        ax.text(0.5, 0.5, "no table angle was solved for", ha="center", transform=ax.transAxes)
    ax.axhline(0.0, color="#888888", linewidth=0.8)
    ax.set(xlabel="commanded, degrees", ylabel="degrees")


def _legend(ax: "Axes") -> None:
    if ax.get_legend_handles_labels()[0]:
        ax.legend(frameon=False)


def _page(outcome: CalibrationOutcome, picture: bytes) -> bytes:
    said = "".join(f"<li class=doubt>{html.escape(text)}</li>" for text in outcome.doubts)
    said += "".join(f"<li>{html.escape(text)}</li>" for text in outcome.notes)
    rows = "".join(
        f"<tr><td>{html.escape(v.name)}<td>{v.role.value}<td>{_number(v.corner_px)}"
        f"<td>{', '.join(f'{html.escape(n)} {mm:.3f}' for n, mm in v.stripe_mm.items())}"
        f"<td>{_number(v.commanded_deg)}<td>{_number(v.angle_error_deg)}</tr>"
        for v in outcome.views
    )
    encoded = base64.b64encode(picture).decode()
    return f"""<!doctype html>
<html lang=en><meta charset=utf-8><meta name=viewport content="width=device-width">
<title>Calibration report</title>
<style>
:root {{ color-scheme: light dark }}
body {{ font: 16px/1.5 system-ui, sans-serif; margin: 2rem auto; max-width: 75rem; padding: 0 1rem }}
img {{ max-width: 100%; background: white }} pre {{ overflow-x: auto }}
td, th {{ padding: .1rem .8rem .1rem 0; text-align: left; font-variant-numeric: tabular-nums }}
.doubt {{ font-weight: bold; color: #c0392b }}
</style>
<h1>Calibration report</h1>
<ul>{said}</ul>
<pre>{html.escape(chr(10).join(report_lines(outcome)))}</pre>
<img alt="Residuals, coverage, stripe residuals and table wobble" src="data:image/png;base64,{encoded}">
<details><summary>All {len(outcome.views)} views</summary>
<table><tr><th>frame<th>role<th>corners, px<th>stripe, mm<th>angle<th>angle error</tr>{rows}</table></details>
</html>
""".encode()


def _number(value: float) -> str:
    return f"{value:.3f}" if np.isfinite(value) else ""
