"""Pictures of results: axes first, artists returned, nothing shown and nothing written.

Plots know results, never solvers.  What each picture says is in its module; what they look like is in `style`.
"""

from lab.plots.clouds import draw_cloud
from lab.plots.comparison import draw_cost, draw_ess, draw_evidence, draw_gap, draw_loop_closure
from lab.plots.corridors import corridor, draw_corridors
from lab.plots.ellipses import ellipse
from lab.plots.forecast import draw_forecast, draw_predicted_error
from lab.plots.instant import draw_instant, draw_truth
from lab.plots.scene import draw_map
from lab.plots.style import legend_below, new_figure

__all__ = [
    "corridor",
    "draw_cloud",
    "draw_corridors",
    "draw_cost",
    "draw_ess",
    "draw_evidence",
    "draw_forecast",
    "draw_gap",
    "draw_instant",
    "draw_loop_closure",
    "draw_map",
    "draw_predicted_error",
    "draw_truth",
    "ellipse",
    "legend_below",
    "new_figure",
]
