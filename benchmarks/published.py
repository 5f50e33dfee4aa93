"""Published results of other systems, to compare with ours.

Source: J. Wang and J. D. Gammell, "Event-Based Stereo Visual Odometry With Native Temporal
Resolution via Continuous-Time Gaussian Process Regression", RA-L 2023, Tables I and II. GPCT is
their method; the ESVO rows are their runs of Y. Zhou, G. Gallego and S. Shen, "Event-Based Stereo
Visual Odometry", T-RO 2021.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import nan

from gpvo.evaluation.metrics.paper_errors import COMPONENTS, Component, PaperStatistics
from gpvo.evaluation.report.paper_tables import ErrorRow

GlobalNumbers = tuple[float, float, float, float, float]
RelativeNumbers = tuple[float, float, float]


def _row(
    name: str,
    global_error: tuple[GlobalNumbers, GlobalNumbers, GlobalNumbers],
    relative_error: tuple[RelativeNumbers, RelativeNumbers, RelativeNumbers],
) -> ErrorRow:
    """Make a row from (max, max %, final %, RMS, std) and 1000 (max, RMS, std) by component."""
    globals_ = (PaperStatistics(*numbers) for numbers in global_error)
    relatives = (
        PaperStatistics(1e-3 * largest, nan, nan, 1e-3 * rms, 1e-3 * std)
        for largest, rms, std in relative_error
    )
    return ErrorRow(f"{name} (published)", _by_component(globals_), _by_component(relatives))


def _by_component(statistics: Iterable[PaperStatistics]) -> dict[Component, PaperStatistics]:
    return dict(zip(COMPONENTS, statistics, strict=True))


PAPER_ROWS: dict[str, list[ErrorRow]] = {
    "indoor_flying1": [
        _row(
            "GPCT",
            (
                (0.635, 7.58, 5.73, 0.372, 0.192),
                (0.195, 7.98, 7.6, 0.087, 0.05),
                (0.639, 7.18, 5.78, 0.382, 0.196),
            ),
            ((73, 7.5, 5.3), (18, 2.4, 1.4), (74, 7.9, 5.3)),
        ),
        _row(
            "ESVO",
            (
                (0.642, 7.66, 6.61, 0.477, 0.152),
                (0.189, 8.87, 6.8, 0.139, 0.039),
                (0.663, 7.55, 6.51, 0.497, 0.155),
            ),
            ((75, 17, 9.2), (43, 7.2, 3.9), (86, 18, 9.2)),
        ),
    ],
    "indoor_flying3": [
        _row(
            "GPCT",
            (
                (0.306, 5.11, 5.08, 0.218, 0.059),
                (0.088, 4.23, 4.13, 0.051, 0.023),
                (0.319, 4.95, 4.93, 0.224, 0.061),
            ),
            ((32, 5.5, 3.6), (13, 2.3, 1.3), (32, 5.9, 3.6)),
        ),
        _row(
            "ESVO",
            (
                (0.683, 11.4, 4.33, 0.232, 0.104),
                (0.165, 8.66, 2.39, 0.038, 0.02),
                (0.697, 10.9, 4.12, 0.235, 0.103),
            ),
            ((219, 24, 19), (63, 8.3, 5.6), (220, 25, 19)),
        ),
    ],
}

DSEC_ATE: dict[str, dict[str, float]] = {
    "zurich_city_04_a": {"ESVO": 3.74, "ESVIO_AA": 1.08},
    "zurich_city_04_b": {"ESVO": 0.91, "ESVIO_AA": 0.67},
    "zurich_city_04_c": {"ESVO": 13.57, "ESVIO_AA": 6.38},
    "zurich_city_04_d": {"ESVO": 26.77, "ESVIO_AA": 7.00},
    "zurich_city_04_e": {"ESVO": 7.95, "ESVIO_AA": 1.30},
    "zurich_city_11_a": {"ESVO": 3.64, "ESVIO_AA": 0.93},
}
"""SE(3)-aligned ATE (RMSE, metres) of the trajectories that ESVIO_AA's authors published."""
