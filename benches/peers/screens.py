"""Milliseconds that other libraries take for a phase screen of 512 samples a side, von Karman's spectrum with an outer scale.

    pip install aotools hcipy; python3 benches/peers/screens.py

`cargo bench -- wave` makes ten of ours and sends a beam through them.
"""

import importlib.util
import statistics
import time

N, WIDTH_M, R0_M, OUTER_M = 512, 0.512, 0.09, 20.0
COUNT = 10


def milliseconds(make):
    """Median over some screens [ms]."""
    make()
    times = []
    for _ in range(COUNT):
        begun = time.perf_counter()
        make()
        times.append(1e3 * (time.perf_counter() - begun))
    return statistics.median(times)


def aotools():
    from aotools.turbulence.phasescreen import ft_sh_phase_screen

    return milliseconds(lambda: ft_sh_phase_screen(R0_M, N, WIDTH_M / N, OUTER_M, 0.005))


def hcipy():
    import hcipy

    grid = hcipy.make_pupil_grid(N, WIDTH_M)
    strength = hcipy.Cn_squared_from_fried_parameter(R0_M, 1.064e-6)
    layer = hcipy.FiniteAtmosphericLayer(grid, strength, OUTER_M)

    def make():
        layer.reset()
        return layer.phase_for(1.064e-6)

    return milliseconds(make)


for name, measure in (("aotools", aotools), ("hcipy", hcipy)):
    if importlib.util.find_spec(name):
        print(f"{name}: {measure():.1f} ms a screen")
    else:
        print(f"{name}: is not installed here; pip install {name}")
