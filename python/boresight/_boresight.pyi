"""
What the package `boresight` is made of; use it through that.
"""

from _typeshed import SupportsGetItem, SupportsLenAndGetItem
from collections.abc import Sequence
from numpy import float64, uint8
from numpy.typing import NDArray
from os import PathLike
from pathlib import Path
from typing import Any, Final, SupportsFloat, SupportsIndex, final
from typing_extensions import disjoint_base

__all__ = ["__version__", "Air", "Beam", "Camera", "Event", "Frame", "Mount", "Picture", "Plant", "PointingInput", "Recording", "Seen", "Simulation", "Snapshot", "Station", "Track", "Uav", "command"]

__version__: Final[str]

@final
class Air:
    """
    Weather and light.
    """
    @property
    def city(self, /) -> str:
        """
        What the city is, in words.
        """
    @property
    def cn2_10m(self, /) -> float:
        """
        Structure parameter of the refractive index 10 m above the first station's ground [m^(-2/3)].
        """
    @property
    def pressure_pa(self, /) -> float:
        """
        Pressure [Pa].
        """
    @property
    def relative_humidity(self, /) -> float:
        """
        Relative humidity, 0 to 1.
        """
    @property
    def sun_dir_enu(self, /) -> NDArray[float64]:
        """
        Direction to the sun, a unit vector.

        Shape [3].
        """
    @property
    def temperature_k(self, /) -> float:
        """
        Temperature [K].
        """
    @property
    def visibility_m(self, /) -> float:
        """
        Meteorological visibility [m].
        """
    @property
    def wind_from_rad(self, /) -> float:
        """
        Direction the wind blows from, clockwise from north [rad].
        """
    @property
    def wind_speed_mps(self, /) -> float:
        """
        Mean wind speed at 10 m [m/s].
        """

@final
class Beam:
    """
    A beam as a tick left it.
    """
    @property
    def aimed(self, /) -> int | None:
        """
        The UAV nearest to the beam's axis: its number in the scenario; None where there is none.
        """
    @property
    def dwell_s(self, /) -> float:
        """
        Time for which the firing beam's centre lay on the target's aim point [s].
        """
    @property
    def energy_j(self, /) -> float:
        """
        Energy emitted since the start [J].
        """
    @property
    def firing(self, /) -> bool:
        """
        Whether the laser emitted.
        """
    @property
    def irradiance_wpm2(self, /) -> float:
        """
        Mean irradiance over that bucket [W/m²].
        """
    @property
    def offset_m(self, /) -> float:
        """
        Distance of the beam's centre from its aim point [m].
        """
    @property
    def on_aim_point(self, /) -> bool:
        """
        Whether the firing beam's centre lay on that aim point, with nothing in between.
        """
    @property
    def peak_wpm2(self, /) -> float:
        """
        Greatest irradiance in the spot [W/m²].
        """
    @property
    def power_at_target_w(self, /) -> float:
        """
        Power that arrives at that UAV's range [W].
        """
    @property
    def power_in_bucket_w(self, /) -> float:
        """
        Power inside the bucket about its aim point [W].
        """
    @property
    def scintillation(self, /) -> float:
        """
        Relative intensity by scintillation.
        """
    @property
    def spot_radius_m(self, /) -> float:
        """
        Short-term 1/e² radius at its range [m].
        """
    @property
    def transmittance(self, /) -> float:
        """
        Transmittance of the air.
        """

@final
class Camera:
    """
    A camera of a station.
    """
    @property
    def believed_pose(self, /) -> NDArray[float64]:
        """
        The same as the station believes it.

        Shape [4, 4].
        """
    @property
    def exposure_s(self, /) -> float | None:
        """
        Exposure time times gain [s]; None before the first exposure.
        """
    @property
    def focal_px(self, /) -> float:
        """
        Focal length over pixel pitch [px].
        """
    @property
    def latency_s(self, /) -> float:
        """
        Time from an exposure to the arrival of its detections [s].
        """
    @property
    def name(self, /) -> str:
        """
        Its name.
        """
    @property
    def period_s(self, /) -> float:
        """
        Time between exposures [s].
        """
    @property
    def pose(self, /) -> NDArray[float64]:
        """
        True pose: takes points of the camera (right, down, forward) to east, north, up of the site [m].

        Shape [4, 4].
        """
    @property
    def sensor_px(self, /) -> tuple[int, int]:
        """
        Width and height of its sensor [px].
        """
    @property
    def tier(self, /) -> str:
        """
        "search", "coarse" or "precise".
        """

@final
class Event:
    """
    Something that happened in a tick.
    """
    def __repr__(self, /) -> str: ...
    @property
    def data(self, /) -> dict[str, Any]:
        """
        What more there is to say, by name: "station", "to", "reason", "order", "answer", "at", "uav", "name", "status".
        """
    @property
    def kind(self, /) -> str:
        """
        "state", "order", "fire", "cease_fire", "uav" or "at_asset".
        """
    @property
    def t_s(self, /) -> float:
        """
        Simulated time [s].
        """
    @property
    def tick(self, /) -> int:
        """
        The tick.
        """

@final
class Frame:
    """
    One exposure of a camera, with the truth of its very tick. It stays as it is while the run goes on.
    """
    def __repr__(self, /) -> str: ...
    @property
    def believed_pose(self, /) -> NDArray[float64]:
        """
        The same as the station believed it.

        Shape [4, 4].
        """
    @property
    def camera(self, /) -> str:
        """
        Name of the camera.
        """
    @property
    def focal_px(self, /) -> float:
        """
        Focal length over pixel pitch [px]; the optical axis meets the sensor in its middle.
        """
    @property
    def number(self, /) -> int:
        """
        Exposures of this camera before this one.
        """
    @property
    def offset_px(self, /) -> tuple[int, int]:
        """
        Column and row of the sensor at which the pixels that were read out begin [px].
        """
    @property
    def pixels(self, /) -> NDArray[uint8] | None:
        """
        The pixels that were read out, red, green, blue; a fresh array each time. None in a run without pictures.

        Shape [height, width, 3].
        """
    @property
    def pose(self, /) -> NDArray[float64]:
        """
        True pose: takes points of the camera (right, down, forward) to east, north, up of the site [m].

        Shape [4, 4].
        """
    @property
    def sensor_px(self, /) -> tuple[int, int]:
        """
        Width and height of the whole sensor [px].
        """
    @property
    def size_px(self, /) -> tuple[int, int]:
        """
        Width and height of what was read out [px].
        """
    @property
    def t_s(self, /) -> float:
        """
        Simulated time of the exposure [s].
        """
    @property
    def tick(self, /) -> int:
        """
        Tick of the exposure.
        """
    @property
    def tier(self, /) -> str:
        """
        "search", "coarse" or "precise".
        """
    @property
    def truth(self, /) -> list[Seen]:
        """
        Truth: the UAVs and distractors in front of the camera.
        """

@final
class Mount:
    """
    A mount as a tick left it. Azimuths run clockwise from north; rates are relative to the base; deflections are of the
    line of sight, right and up.
    """
    @property
    def az_el_rad(self, /) -> NDArray[float64]:
        """
        True azimuth and elevation [rad].

        Shape [2].
        """
    @property
    def base_tilt_rad(self, /) -> NDArray[float64]:
        """
        Tilt of the base, a rotation vector about east, north, up [rad].

        Shape [3].
        """
    @property
    def believed_axis_enu(self, /) -> NDArray[float64]:
        """
        Where the station believes its laser to point, a unit vector.

        Shape [3].
        """
    @property
    def commanded_mirror_rad(self, /) -> NDArray[float64]:
        """
        Deflection commanded for the next tick [rad].

        Shape [2].
        """
    @property
    def commanded_rates_radps(self, /) -> NDArray[float64]:
        """
        Rates commanded for the next tick [rad/s].

        Shape [2].
        """
    @property
    def laser_pose(self, /) -> NDArray[float64]:
        """
        True pose of the laser: takes points of it to east, north, up of the site [m]; it points along its third axis.

        Shape [4, 4].
        """
    @property
    def measured_az_el_rad(self, /) -> NDArray[float64]:
        """
        Azimuth and elevation by the encoders [rad].

        Shape [2].
        """
    @property
    def measured_rates_radps(self, /) -> NDArray[float64]:
        """
        Rates by the gyros [rad/s].

        Shape [2].
        """
    @property
    def mirror_at_stop(self, /) -> bool:
        """
        Whether the mirror is at a stop.
        """
    @property
    def mirror_rad(self, /) -> NDArray[float64]:
        """
        Deflection by the mirror [rad].

        Shape [2].
        """
    @property
    def r_enu_m(self, /) -> NDArray[float64]:
        """
        Where the axes cross, east, north, up of the site [m].

        Shape [3].
        """
    @property
    def rates_radps(self, /) -> NDArray[float64]:
        """
        True rates of azimuth and elevation [rad/s].

        Shape [2].
        """

@final
class Picture:
    """
    What a detector is asked about.
    """
    @property
    def frame(self, /) -> Frame:
        """
        The frame that they are of. It carries its truth, for tests: a detector that reads it proves nothing.
        """
    @property
    def offset_px(self, /) -> tuple[int, int]:
        """
        Column and row of the whole sensor at which they begin [px].
        """
    @property
    def pixels(self, /) -> NDArray[uint8]:
        """
        The pixels in which to look, red, green, blue; boxes are answered in these pixels.

        Shape [height, width, 3].
        """

@final
class Plant:
    """
    What a pointing law is made for.
    """
    @property
    def bandwidths_hz(self, /) -> tuple[float, float]:
        """
        Bandwidths of the rate loops of azimuth and elevation [Hz].
        """
    @property
    def dt_s(self, /) -> float:
        """
        Time between two commands [s].
        """
    @property
    def mirror_stroke_rad(self, /) -> float:
        """
        Farthest that the mirror deflects the line of sight, to each side [rad].
        """
    @property
    def rate_limits_radps(self, /) -> tuple[float, float]:
        """
        Fastest rates of azimuth and elevation [rad/s].
        """

@final
class PointingInput:
    """
    What a pointing law reads at the start of a tick. Azimuths run clockwise from north; deflections are right and up.
    """
    @property
    def base_rate_radps(self, /) -> NDArray[float64]:
        """
        Angular velocity of the base by its gyro [rad/s].

        Shape [3].
        """
    @property
    def base_tilt_rad(self, /) -> NDArray[float64]:
        """
        Tilt of the base by its gyro, a rotation vector about east, north, up [rad].

        Shape [3].
        """
    @property
    def deflection_rad(self, /) -> NDArray[float64]:
        """
        Deflection by the mirror that would put the boresight on the target [rad].

        Shape [2].
        """
    @property
    def error_rad(self, /) -> NDArray[float64]:
        """
        Angles of azimuth and elevation still to turn [rad].

        Shape [2].
        """
    @property
    def gimbal_az_el_rad(self, /) -> NDArray[float64]:
        """
        Azimuth and elevation by the encoders [rad].

        Shape [2].
        """
    def gimbal_rates(self, /, gains_per_s: Sequence[float] | NDArray[float64]) -> NDArray[float64]:
        """
        Rates for the gimbal [rad/s] that turn it to the target by these gains [1/s], and no faster than its motors can
        follow from the rate in force.

        Shape [2].
        """
    @property
    def gimbal_rates_radps(self, /) -> NDArray[float64]:
        """
        Rates by the gyros [rad/s].

        Shape [2].
        """
    @property
    def los_az_el_rad(self, /) -> NDArray[float64]:
        """
        Predicted azimuth and elevation of the line of sight [rad].

        Shape [2].
        """
    @property
    def los_rates_radps(self, /) -> NDArray[float64]:
        """
        Rates of that [rad/s].

        Shape [2].
        """
    def mirror(self, /, wanted_rad: Sequence[float] | NDArray[float64]) -> NDArray[float64]:
        """
        Deflection to be set [rad] on the mirror's way to the one wanted [rad], at a bounded rate.

        Shape [2].
        """
    @property
    def mirror_rad(self, /) -> NDArray[float64]:
        """
        Deflection by the mirror's sensor [rad].

        Shape [2].
        """
    @property
    def mirror_rates_radps(self, /) -> NDArray[float64]:
        """
        Rate of that [rad/s].

        Shape [2].
        """
    @property
    def rates_radps(self, /) -> NDArray[float64]:
        """
        Rates of the line of sight relative to the moving base [rad/s].

        Shape [2].
        """

@disjoint_base
class Recording:
    """
    The recording of a run.

    The base of `boresight.Recording`, which makes tables of its messages.
    """
    def __new__(cls, /, path: str | PathLike[str]) -> Recording: ...
    def messages(self, /, topic: str) -> list[tuple[float, dict[str, Any]]]:
        """
        The messages of a topic: a list of (time [s], fields by name). Bytes are base64 text.
        """
    @property
    def overrides(self, /) -> list[str]:
        """
        The changes that were made to it.
        """
    @property
    def path(self, /) -> Path:
        """
        The file.
        """
    @property
    def scenario(self, /) -> str:
        """
        The scenario file as it was read.
        """
    @property
    def seed(self, /) -> int:
        """
        Seed of the run.
        """
    @property
    def tick_hz(self, /) -> int:
        """
        Ticks a second [Hz].
        """
    def topics(self, /) -> dict[str, int]:
        """
        Its topics, each with the number of its messages.
        """
    @property
    def version(self, /) -> str:
        """
        Version of the program that made it.
        """
    @property
    def whole(self, /) -> bool:
        """
        Whether it ends as a finished one does; that of a killed run lacks its last moments.
        """

@final
class Seen:
    """
    A UAV or distractor in front of a camera, in truth. Boxes are x0, y0, x1, y1 in pixels of the whole sensor.
    """
    def __repr__(self, /) -> str: ...
    @property
    def aim_px(self, /) -> tuple[float, float]:
        """
        Projection of the point aimed at [px].
        """
    @property
    def box_px(self, /) -> tuple[float, float, float, float]:
        """
        Box around the projection of its airframe [px].
        """
    @property
    def clear(self, /) -> bool:
        """
        Whether nothing stands between the camera and the point aimed at.
        """
    @property
    def distractor(self, /) -> bool:
        """
        Whether it is no UAV.
        """
    @property
    def range_m(self, /) -> float:
        """
        Distance from the camera [m].
        """
    @property
    def uav(self, /) -> int:
        """
        Its number in the scenario; distractors come after all UAVs.
        """
    @property
    def visible_box_px(self, /) -> tuple[float, float, float, float] | None:
        """
        Box around its visible pixels [px]; None where none is visible, and in a run without pictures.
        """
    @property
    def visible_fraction(self, /) -> float | None:
        """
        Visible share of its outline, 0 to 1; None in a run without pictures.
        """

@disjoint_base
class Simulation:
    """
    A run: opened, stepped, looked at, given orders, finished.

    The base of `boresight.Simulation`, which says how it is opened.
    """
    def __new__(cls, /, path: str | PathLike[str], text: str | None, seed: SupportsIndex | None, set: SupportsGetItem[int, str], pictures: bool | None, record: str | PathLike[str] | None, threads: SupportsIndex | None, laws: dict[str, Any], detectors: dict[str, Any]) -> Simulation: ...
    def _drive(self, /, rates_degps: SupportsLenAndGetItem[SupportsFloat | SupportsIndex] | None, mirror_urad: SupportsLenAndGetItem[SupportsFloat | SupportsIndex] | None, station: str | None) -> None:
        """
        Drives gimbal \\[°/s\\] and mirror \\[µrad\\] from outside.
        """
    def _finish(self, /) -> str | None:
        """
        Ends the run where it is, and returns its summary as JSON; None where it was finished before.
        """
    def _give(self, /, order: str) -> None:
        """
        Gives an order, as TOML.
        """
    def _summary(self, /) -> str:
        """
        The run summed up as far as it went, as JSON.
        """
    @property
    def air(self, /) -> Air:
        """
        Weather and light.
        """
    @property
    def events(self, /) -> list[Event]:
        """
        What happened in the last step, in order of time.
        """
    @property
    def frames(self, /) -> list[Frame]:
        """
        The newest frame of each camera that exposed in the last step. A step no longer than a camera's period misses none.
        """
    @property
    def last_tick(self, /) -> int:
        """
        The tick after which the run ends at the latest.
        """
    @property
    def over(self, /) -> bool:
        """
        Whether the run has come to its end.
        """
    def restore(self, /, snapshot: Snapshot) -> None:
        """
        Goes back to a snapshot of this run, or on to one: from there it goes on bit for bit as it did before. A run that is
        recorded refuses.
        """
    def run_until(self, /, t_s: SupportsFloat | SupportsIndex) -> bool:
        """
        Lets time pass until `t_s` [s], or the run's end; True once it is over.
        """
    def scenario_with_orders(self, /) -> str:
        """
        The scenario as TOML, with seed and orders of this run: run again, with the same parts, it is the same run.
        """
    @property
    def seed(self, /) -> int:
        """
        Seed of every random stream.
        """
    def snapshot(self, /) -> Snapshot:
        """
        The run's state, to go back to by `restore`: clocks, random streams, UAVs, mount, tracks, laws (by `copy.deepcopy`),
        orders. A detector's own memory is not held. It may be taken of a run that is recorded, too.
        """
    @property
    def state_hash(self, /) -> int:
        """
        Hash of the whole state; each tick's covers the one before.
        """
    @property
    def stations(self, /) -> list[Station]:
        """
        The stations, in the order of the scenario.
        """
    def step(self, /, ticks: SupportsIndex = 1) -> bool:
        """
        Lets so many ticks pass, fewer if the run ends before; True once it is over. Ctrl-C stops between two ticks.
        """
    @property
    def t_s(self, /) -> float:
        """
        Simulated time [s].
        """
    @property
    def tick(self, /) -> int:
        """
        Ticks since the start.
        """
    @property
    def tick_hz(self, /) -> int:
        """
        Ticks a second [Hz].
        """
    @property
    def uavs(self, /) -> list[Uav]:
        """
        The UAVs in the order of the scenario, and after them the distractors: the truth.
        """

@final
class Snapshot:
    """
    A run's state between two ticks; it belongs to the run that it was taken of.
    """
    @property
    def tick(self, /) -> int:
        """
        Ticks from the start of the run.
        """

@final
class Station:
    """
    A station of a run. It shows the present: read it again after a step.
    """
    def __repr__(self, /) -> str: ...
    @property
    def arrived(self, /) -> list[tuple[Frame, list[tuple[float, float, float, float, float, int]]]]:
        """
        The answers of the detector that arrived in the last tick: a list of (frame, detections), a detection being
        (x0, y0, x1, y1, score, label) in pixels of the whole sensor.
        """
    @property
    def beam(self, /) -> Beam:
        """
        What the beam did in the last tick.
        """
    @property
    def cameras(self, /) -> list[Camera]:
        """
        The cameras, in the order of the scenario.
        """
    @property
    def interlocks(self, /) -> list[str]:
        """
        Why the laser may not fire; empty while it may.
        """
    @property
    def law(self, /) -> str:
        """
        Name of the pointing law in force.
        """
    @property
    def mount(self, /) -> Mount:
        """
        Gimbal, mirror and base.
        """
    @property
    def name(self, /) -> str:
        """
        Its name.
        """
    @property
    def radar(self, /) -> list[tuple[int, float, float, float]]:
        """
        Where the radar has its targets now: a list of (number, azimuth [rad], elevation [rad], range [m]); the number
        is the UAV's in the scenario where the radar plots the truth, otherwise that of the radar's track.
        """
    @property
    def state(self, /) -> str:
        """
        State of the engagement: "search", "acquire", "coarse", "precise", "engage" or "lost".
        """
    @property
    def target(self, /) -> Track | None:
        """
        The target's track, or None.
        """
    @property
    def target_uav_probability(self, /) -> float | None:
        """
        Probability that the target is a UAV, as far as fire is concerned; None without a target.
        """
    @property
    def tracks(self, /) -> list[Track]:
        """
        The tracks, in the order of their identities.
        """

@final
class Track:
    """
    What a tracker believes of one object, carried on to the present tick.
    """
    def __repr__(self, /) -> str: ...
    @property
    def az_el_rad(self, /) -> NDArray[float64]:
        """
        Azimuth and elevation [rad].

        Shape [2].
        """
    @property
    def hits(self, /) -> int:
        """
        Frames that have shown it, of all cameras.
        """
    @property
    def id(self, /) -> int:
        """
        Its identity, which no other track of the run ever has.
        """
    @property
    def is_target(self, /) -> bool:
        """
        Whether it is the target.
        """
    @property
    def motion_enu(self, /) -> tuple[NDArray[float64], NDArray[float64]] | None:
        """
        Position [m] and velocity [m/s], east, north, up of the site; None where the range is not known.

        Shape [3] each.
        """
    @property
    def range_m(self, /) -> tuple[float, float] | None:
        """
        Range and its standard deviation [m]; None where it is not known.
        """
    @property
    def rates_radps(self, /) -> NDArray[float64]:
        """
        Rates of azimuth and elevation [rad/s].

        Shape [2].
        """
    @property
    def sigma_rad(self, /) -> NDArray[float64]:
        """
        Standard deviation of those [rad].

        Shape [2].
        """
    @property
    def size_rad(self, /) -> float:
        """
        Larger side of its box on the sky [rad].
        """
    @property
    def uav_probability(self, /) -> float:
        """
        Probability that it is a UAV.
        """

@final
class Uav:
    """
    A UAV or distractor: the truth.
    """
    def __repr__(self, /) -> str: ...
    @property
    def acquired_s(self, /) -> float | None:
        """
        When a camera of a station first held it [s]; None before.
        """
    @property
    def aim_enu_m(self, /) -> NDArray[float64]:
        """
        Where the part aimed at is [m].

        Shape [3].
        """
    @property
    def at_asset_s(self, /) -> float | None:
        """
        When it came within the asset's radius unharmed [s]; None before.
        """
    @property
    def distractor(self, /) -> str | None:
        """
        What it is if it is no UAV, such as "bird"; None for a UAV.
        """
    @property
    def dwell_s(self, /) -> float:
        """
        Time for which a firing beam's centre lay on its aim point [s].
        """
    @property
    def energy_j(self, /) -> float:
        """
        Energy that lasers emitted while it was the aimed one [J].
        """
    @property
    def face_k(self, /) -> float | None:
        """
        The hottest place that beams have fallen on [K]; None of a distractor.
        """
    @property
    def hole_m2(self, /) -> float:
        """
        Area that is burnt through [m²].
        """
    @property
    def index(self, /) -> int:
        """
        Its number in the scenario; distractors come after all UAVs.
        """
    @property
    def irradiance_wpm2(self, /) -> float:
        """
        Mean irradiance within 5 cm of the aim point in the last tick [W/m²].
        """
    @property
    def lost(self, /) -> list[str]:
        """
        Parts that lasers have destroyed, in the order of their loss: "body", "battery", "motor", "arm", "camera".
        """
    @property
    def name(self, /) -> str:
        """
        Its name.
        """
    @property
    def neutralised_s(self, /) -> float | None:
        """
        When it was brought down [s]; None before.
        """
    @property
    def r_enu_m(self, /) -> NDArray[float64]:
        """
        Where it is, east, north, up of the site [m].

        Shape [3].
        """
    @property
    def rotation_enu_body(self, /) -> NDArray[float64]:
        """
        How it is turned: from its body's axes (forward, left, up) to east, north, up.

        Shape [3, 3].
        """
    @property
    def size_m(self, /) -> tuple[float, float, float]:
        """
        Length, width and height [m].
        """
    @property
    def skin_k(self, /) -> float | None:
        """
        The hottest of what would fail under beams, a wall that bears or what lies behind one [K]; None of a distractor.
        """
    @property
    def status(self, /) -> str:
        """
        What has become of it: "flying", "falling", "struck", "down", "crashed" or "landed".
        """
    @property
    def v_enu_mps(self, /) -> NDArray[float64]:
        """
        Its velocity over the ground [m/s].

        Shape [3].
        """

def command(arguments: SupportsGetItem[int, str]) -> int:
    """
    Carries a command line out, as `boresight` does, and returns its exit code.
    """
