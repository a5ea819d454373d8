"""Plots of training runs as SVG files; the same numbers make the same file."""

from pathlib import Path

import matplotlib

matplotlib.use("svg")
matplotlib.rcParams.update({"svg.hashsalt": "boresight", "svg.fonttype": "none", "axes.grid": True, "grid.color": "#ddd"})

from matplotlib import pyplot  # noqa: E402


def _figure(title: str, across: str, size: tuple[float, float]):
    figure, axes = pyplot.subplots(figsize=size, layout="constrained")
    axes.set_title(title)
    axes.set_xlabel(across)
    return figure, axes


def _save(figure, path: Path) -> None:
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)


def curves(rows: list[dict], path: Path, title: str) -> None:
    """Every column but step, rate and time against the step, logarithmic upwards."""
    figure, axes = _figure(title, "steps", (8, 4))
    axes.set_yscale("log")
    for name in rows[-1]:
        points = [(int(r["step"]), float(r[name])) for r in rows if r.get(name) and float(r[name]) > 0]
        if points and name not in ("step", "lr", "seconds", "norm"):
            axes.plot(*zip(*points), label=f"{name} {points[-1][1]:.3g}", linewidth=1.3)
    if axes.lines:
        axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
        _save(figure, path)
    else:
        pyplot.close(figure)


def lines(series: dict[str, list[tuple[float, float]]], path: Path, title: str, across: str, top: float) -> None:
    """Points (x, y) of every name over x, from 0 to `top` upwards; `across` says what x is."""
    figure, axes = _figure(title, across, (9, 4))
    for name, points in series.items():
        axes.plot(*zip(*points), label=name, linewidth=1.2)
    axes.set_ylim(0, top)
    axes.legend(loc="center left", bbox_to_anchor=(1, 0.5))
    _save(figure, path)


def reliability(rows: list[dict], path: Path, title: str) -> None:
    """How often what is given a probability of being a UAV is one: `p`, `share` and `weight` of each bin."""
    figure, axes = _figure(title, "probability of being a UAV", (4.2, 4.2))
    axes.set_ylabel("share that are UAVs")
    axes.plot([0, 1], [0, 1], linestyle="--", color="#999")
    p, share, weight = ([row[k] for row in rows] for k in ("p", "share", "weight"))
    axes.plot(p, share, color="#1f4e8c")
    axes.scatter(p, share, s=[10 + 400 * w for w in weight], color="#1f4e8c", alpha=0.5)
    _save(figure, path)
