"""The outcome of a reconstruction in plain lines."""

from app.scanning.report import ReconstructionReport


def reconstruction_lines(report: ReconstructionReport) -> list[str]:
    """Points, angles, lasers, table: what there is to say, nothing that is not known."""
    angles = report.angles
    lines = [f"Points           {report.points:,} in {report.profiles:,} profiles"]
    if report.outside:
        lines.append(f"Outside          {report.outside:,} points left out: not in the region of interest")
    lines.append(f"Table angle      from {angles.source}, {angles.stops} stops")
    if angles.stops_with_markers:
        lines.append(
            f"Markers          seen at {angles.stops_with_markers} stops, {angles.marker_rms_px:.2f} px RMS; "
            f"{angles.rms_deg:.2f} degrees RMS from the commanded angle, {angles.largest_deg:.2f} at most"
        )
    lines += [
        f"Lasers           {pair.first} and {pair.second} differ by {pair.disagreement_mm:.3f} mm "
        f"(median {pair.offset_mm:+.3f} mm, {pair.rms_mm:.3f} mm RMS over {pair.pairs:,} places)"
        for pair in report.agreements
    ]
    lines += [
        f"Table            {table.offset_mm:+.3f} mm and {table.tilt_deg:.2f} degrees from the "
        f"calibration, {table.rms_mm:.3f} mm RMS flat (by its {table.source})"
        for table in report.tables
    ]
    if report.drift.findings:
        found = ", ".join(f"{f.name} {f.value:.3f} {f.unit}" for f in report.drift.findings)
        lines.append(f"Drift            {report.drift.level}: {found}")
    return lines
