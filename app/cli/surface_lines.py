"""The outcome of finishing a cloud in plain lines."""

from app.geometry.mesh import TriangleMesh
from app.surface.finish import FinishReport


def finish_lines(report: FinishReport, mesh: TriangleMesh) -> list[str]:
    """Points, steps, triangles, and what a printer would want to know."""
    lines = [f"Points           {report.points:,}"]
    if report.copies:
        lines.append(f"Copies           {report.copies:,} points left out: not finite, or where another is")
    if report.thinned:
        lines.append(f"Thinned          {report.thinned:,} points left out: too many")
    for number, step in enumerate(report.steps):
        left_out = f"{step.before - step.after:,} left out, {step.after:,} stay"
        lines.append(f"{'Cleaned' if number == 0 else '':<16} {step.kind}: {left_out}")
        if step.note:
            lines.append(f"{'':<16} {step.note}")
    lines.append(f"Mesh             {len(mesh):,} triangles")
    printing = report.printing
    if printing is None:
        return lines
    width, depth, height = printing.size_mm
    lines.append(f"Size             {width:.1f} x {depth:.1f} x {height:.1f} mm")
    lines.append(
        f"Volume           {printing.volume_cm3:.1f} cm3, {printing.pla_g:.0f} g of PLA if printed solid"
    )
    if report.guessed_share:
        lines.append(f"Guessed          {100.0 * report.guessed_share:.1f} % of the surface")
    return lines
