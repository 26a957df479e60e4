"""Plots of the losses of a run."""

import io
from collections.abc import Sequence
from typing import Any


def loss_curves_png(entries: Sequence[dict[str, Any]], title: str) -> bytes:
    """Plot training and held-out losses over minutes, total and parts, as a PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.ticker import ScalarFormatter

    names = ["loss", *dict.fromkeys(name for e in entries for name in e["parts"])]
    columns = min(3, len(names))
    rows = -(-len(names) // columns)
    figure = Figure(figsize=(4.5 * columns, 3.2 * rows), layout="constrained")
    FigureCanvasAgg(figure)
    figure.suptitle(title)
    for index, name in enumerate(names):
        axes = figure.add_subplot(rows, columns, index + 1)
        is_drawn = False
        for held_out, style, label in (
            (False, {"color": "#9db4c0", "linewidth": 1}, "training"),
            (True, {"color": "#c1121f", "marker": ".", "linewidth": 1.5}, "held out"),
        ):
            points = [
                (entry["minutes"], entry["loss" if index == 0 else "parts"])
                for entry in entries
                if entry["held_out"] == held_out
            ]
            points = [(at, v if index == 0 else v.get(name)) for at, v in points]
            points = [(at, v) for at, v in points if v is not None]
            if points:
                axes.plot(*zip(*points, strict=True), label=label, **style)
                is_drawn = is_drawn or all(value > 0 for _, value in points)
        if is_drawn:
            axes.set_yscale("log")
            axes.yaxis.set_major_formatter(ScalarFormatter())
            axes.yaxis.set_minor_formatter(ScalarFormatter())
        axes.set_title(name, fontsize=10)
        axes.set_xlabel("minutes of training")
        axes.grid(visible=True, alpha=0.3)
        if index == 0:
            axes.legend()
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=100)
    return buffer.getvalue()
