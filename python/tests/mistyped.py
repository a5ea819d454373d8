"""What a type checker must refuse; `test_types.py` counts on one error in each marked line."""

import boresight
from boresight import client

run = boresight.Simulation("scenarios/urban_intercept.toml", seed=7.5)  # error
run.stepp(3)  # error
run.run_until("soon")  # error
first: str = run.stations[0].mount.az_el_rad  # error
print(run.frames[0].pixels.mean())  # error
run.t_s = 3.0  # error
boresight.Simulation(5)  # error
boresight.Simulation("a.toml", detectors={"mine": object()})  # error
client.Order(drive=3)  # error
