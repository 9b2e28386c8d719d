"""Stripe centre where the response to a derivative kernel changes its sign; each with a variance."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from app.vision.candidates import Candidates, Measured, find_candidates, stripes_of
from app.vision.kernels import Kernels, kernels
from app.vision.kernels.results import Refined, Shape, Windows
from app.vision.noise import LARGEST_CONTRAST, measured_shape
from app.vision.stripe import STRIPE_DETECTORS, LaserStripe, LaserView

# Without a dark partner the edge of a surface's own brightness pulls at the stripe: by this many pixels
# for a step as high as the stripe itself.
_EDGE_PULL_PX = 0.6
# The stripe's foot, where the background begins, in stripe sigmas.
_FOOT_SIGMAS = 3.0
# Scoring is given up where it makes the stripe this much rougher. Not less: what a plain zero crossing does
# wrong at a clipped core changes slowly along the stripe and looks smooth.
_ROUGHER = 1.1


@dataclass(frozen=True, slots=True)
class ZeroCrossingDetector:
    """The default: a tenth of a pixel and better, and it says how good each point is.

    In short: strongest peak of every line, its middle at half height, centre of gravity, zero crossing of
    the response to k exp(-k^2 / 2 sf^2), and where it helps Fisher scoring with the camera's noise.

    Attributes:
        min_strength: a peak is no stripe below this height, grey levels.
        sigma_px: sigma of the stripe; 0 measures it in each picture.
        filter_ratio: sigma of the kernel in stripe sigmas.
        contrast: of the speckle, standard deviation over mean, as the weights have it.
        gain: electrons per grey level.
        read_noise: of one pixel in the dark, grey levels.
        scoring: Fisher scoring after the zero crossing; None takes it where it makes the picture's stripe
            smoother, which it does not in pictures that a camera has sharpened.
        evens_albedo: divides by the dark partner where that changes its brightness across the stripe.
        narrowest, widest: a peak outside these multiples of the picture's stripe sigma is left out.
        max_second: a line whose next peak is a larger share of the stripe than this is left out, 0..1.
        smooth_rows: neighbours along an unbroken piece that are averaged; 0 for calibration, 7 for scans.
        measures_noise: scales the variances of a picture to the roughness of its stripe.
        compiled: the compiled kernels or their NumPy twin; None takes what there is.
    """

    min_strength: float = 12.0
    sigma_px: float = 0.0
    filter_ratio: float = 1.25
    contrast: float = 0.1
    gain: float = 40.0
    read_noise: float = 1.5
    scoring: bool | None = None
    evens_albedo: bool = True
    narrowest: float = 0.35
    widest: float = 2.5
    max_second: float = 1.0
    smooth_rows: int = 0
    measures_noise: bool = True
    compiled: bool | None = None

    def detect(self, view: LaserView) -> LaserStripe:
        """The stripe of one picture: the strongest peak of every line."""
        return self.detect_several(view, 1)[0]

    def detect_several(self, view: LaserView, count: int) -> list[LaserStripe]:
        """`count` stripes, in the order in which they lie across the lines."""
        fast = kernels(self.compiled)
        peaks = find_candidates(view, self.min_strength, count, fast)
        sigma = self.sigma_px or peaks.sigma
        shape = Shape(sigma, self.filter_ratio * sigma, self.contrast, self.gain, self.read_noise**2)
        column = np.rint(peaks.centre).astype(np.intp)
        windows = self._cut(peaks, column, shape, fast)
        refined = self._refine(windows, shape, peaks, column, fast)
        variance = refined.variance
        if peaks.dark is None:
            pull_px = _EDGE_PULL_PX * windows.asymmetry / np.maximum(refined.amplitude, 1.0)
            variance = variance + pull_px * pull_px
        saturated = windows.clipped > 0
        across = column + refined.offset
        keep = refined.is_found & (refined.amplitude >= 0.5 * self.min_strength)
        keep &= refined.width >= self.narrowest * sigma
        keep &= (refined.width <= self.widest * sigma) | saturated
        # A stripe that the picture's border cuts has lost its middle.
        keep &= (across >= 1.5 * sigma) & (across <= peaks.lit.shape[1] - 1 - 1.5 * sigma)
        if self.max_second < 1.0:
            keep &= peaks.second <= self.max_second
        found = Measured(
            peaks.line, peaks.track, across, refined.amplitude, variance, refined.width, peaks.second,
            saturated,
        )  # fmt: skip
        return stripes_of(
            found.where(keep), view.orientation, count, fast, self.smooth_rows, self.measures_noise
        )

    def _cut(self, peaks: Candidates, column: NDArray[np.intp], shape: Shape, fast: Kernels) -> Windows:
        core = int(np.ceil(_FOOT_SIGMAS * shape.sigma))
        if peaks.dark is None:
            foot = max(4, int(np.ceil(shape.sigma)))
            half = max(shape.half_window, core + foot)
            return fast.cut_windows(
                peaks.lit, peaks.light, peaks.channel, peaks.line, column, half, core, foot
            )
        albedo_noise = self.read_noise**2 if self.evens_albedo else 0.0
        return fast.cut_windows_between(
            peaks.lit, peaks.dark, peaks.channel, peaks.line, column, shape.half_window, core, albedo_noise
        )

    def _refine(
        self, windows: Windows, shape: Shape, peaks: Candidates, column: NDArray[np.intp], fast: Kernels
    ) -> Refined:
        n = len(column)
        if self.measures_noise:
            windows = windows._replace(floor=np.zeros(n))
            steady = fast.in_long_pieces(peaks.line, peaks.centre)
            shape = measured_shape(windows, steady, shape, fast, self.sigma_px > 0.0)
        wants_scoring = shape.contrast < LARGEST_CONTRAST if self.scoring is None else self.scoring
        plain, scored = fast.refine(windows, shape, wants_scoring)
        if self.scoring is not None or not wants_scoring:
            return scored
        across = column + scored.offset, column + plain.offset
        line = peaks.line
        if not plain.is_found.all():
            line, across = line[plain.is_found], (across[0][plain.is_found], across[1][plain.is_found])
        rough = [fast.median_bend(line, each) for each in across]
        is_smooth = rough[0] <= _ROUGHER * rough[1]
        return scored if is_smooth else plain


STRIPE_DETECTORS.register("zero-crossing", ZeroCrossingDetector)
