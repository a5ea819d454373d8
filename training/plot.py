"""Curves as small SVGs, without a plotting library."""

import math
from pathlib import Path

COLOURS = ("#1f4e8c", "#b3541e", "#2f7d4f", "#7a3b8f", "#8c8c1f", "#444444")


def curves(rows: list[dict], path: Path, title: str, width: int = 720, height: int = 360) -> None:
    """Every column but step, rate and time against the step, logarithmic upwards."""
    names = [k for k in rows[-1] if k not in ("step", "lr", "seconds", "norm")]
    series = {n: [(int(r["step"]), float(r[n])) for r in rows if r.get(n) and float(r[n]) > 0] for n in names}
    series = {n: points for n, points in series.items() if points}
    if not series:
        return
    top = math.ceil(max(math.log10(v) for p in series.values() for _, v in p) * 2) / 2
    low = math.floor(min(math.log10(v) for p in series.values() for _, v in p) * 2) / 2
    last = max(s for p in series.values() for s, _ in p)
    left, right, up, down = 56, width - 130, 34, height - 34

    def x(step: float) -> float:
        return left + (right - left) * step / last

    def y(value: float) -> float:
        return down - (down - up) * (math.log10(value) - low) / max(top - low, 0.5)

    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">']
    out.append(f'<rect width="100%" height="100%" fill="white"/><text x="{left}" y="20">{title}</text>')
    for k in range(int(low * 2), int(top * 2) + 1):
        value = 10 ** (k / 2)
        out.append(f'<path d="M{left} {y(value):.1f}H{right}" stroke="#ddd"/><text x="6" y="{y(value) + 4:.1f}">{value:.3g}</text>')
    out.append(f'<text x="{left}" y="{height - 10}">0</text><text x="{right - 40}" y="{height - 10}">{last} steps</text>')
    for i, (name, points) in enumerate(series.items()):
        colour = COLOURS[i % len(COLOURS)]
        line = " ".join(f"{x(s):.1f},{y(v):.1f}" for s, v in points)
        out.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.3"/>')
        out.append(f'<text x="{right + 8}" y="{up + 16 * i + 10}" fill="{colour}">{name} {points[-1][1]:.3g}</text>')
    path.write_text("\n".join(out) + "\n</svg>\n")


def lines(series: dict[str, list[tuple[float, float]]], path: Path, title: str, across: str, top: float, width: int = 860, height: int = 360) -> None:
    """Points (x, y) of every name over x, from 0 to `top` upwards; `across` says what x is."""
    left, right, up, down = 44, width - 250, 34, height - 44
    last = max(x for points in series.values() for x, _ in points) or 1
    out = [f'<svg xmlns="http://www.w3.org/2000/svg" width="{width}" height="{height}" font-family="sans-serif" font-size="12">']
    out.append(f'<rect width="100%" height="100%" fill="white"/><text x="{left}" y="20">{title}</text>')
    for k in range(6):
        y = down - (down - up) * k / 5
        out.append(f'<path d="M{left} {y:.1f}H{right}" stroke="#ddd"/><text x="6" y="{y + 4:.1f}">{top * k / 5:.3g}</text>')
    out.append(f'<text x="{left}" y="{height - 14}">0</text><text x="{right}" y="{height - 14}" text-anchor="end">{last:.4g} {across}</text>')
    for i, (name, points) in enumerate(series.items()):
        colour = COLOURS[i % len(COLOURS)]
        line = " ".join(f"{left + (right - left) * x / last:.1f},{down - (down - up) * min(y / top, 1):.1f}" for x, y in points)
        out.append(f'<polyline points="{line}" fill="none" stroke="{colour}" stroke-width="1.2"/>')
        out.append(f'<text x="{right + 10}" y="{up + 18 * i + 10}" fill="{colour}">{name}</text>')
    path.write_text("\n".join(out) + "\n</svg>\n")
