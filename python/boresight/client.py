"""A client of `boresight serve`: steps a run in another process, looks at it and gives it orders. Needs nothing but Python.

    from boresight.client import Drive, AzElRates, Order, Run

    with Run("127.0.0.1:7878") as run:
        while not (stepped := run.step(1, state=True)).over:
            mount = stepped.state.stations[0].mount
            run.order(Order(drive=Drive(rates=AzElRates(azimuth_degps=1.0))))

The messages are those of crates/lockstep/proto/lockstep.proto, which says what each field is; names carry the units.
"""

from __future__ import annotations

import dataclasses
import functools
import socket
import struct
from collections.abc import Callable, Sequence
from typing import Any, TypeVar, dataclass_transform

VERSION = 1
MOST_REPLY_BYTES = 256 << 20

M = TypeVar("M")


class ServerError(Exception):
    """What the server refuses, in its own words, or a connection at its end."""


# ---- Protocol buffers ----------------------------------------------------------------------------------------------
#
# A field has its number and its kind: u whole number, b truth value, s text, y bytes, d number, h 64 fixed bits, D numbers, S
# texts, a class for a message, a list of one for messages.


def _field(number: int, kind: Any, default: Any = None) -> Any:
    how = {"default_factory": list} if default is list else {"default": default}
    return dataclasses.field(metadata={"number": number, "kind": kind}, **how)


@functools.cache
def _fields(message: type) -> dict[int, tuple[str, Any]]:
    return {of.metadata["number"]: (of.name, of.metadata["kind"]) for of in dataclasses.fields(message)}


def _varint(value: int) -> bytes:
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def _encoded(message: Any) -> bytes:
    out = bytearray()

    def lengthy(number: int, data: bytes) -> None:
        out.extend(_varint(number << 3 | 2) + _varint(len(data)) + data)

    # Classes can be keys, whatever mypy says.
    for number, (name, kind) in _fields(type(message)).items():  # type: ignore[arg-type]
        value = getattr(message, name)
        if value is None or value == []:
            continue
        if kind in ("u", "b"):
            if not 0 <= int(value) < 1 << 64:
                raise ValueError(f"{name}: {value} must be a whole number from 0 on")
            out += _varint(number << 3) + _varint(int(value))
        elif kind == "d":
            out += _varint(number << 3 | 1) + struct.pack("<d", value)
        elif kind == "h":
            out += _varint(number << 3 | 1) + struct.pack("<Q", value)
        elif kind == "s":
            lengthy(number, value.encode())
        elif kind == "y":
            lengthy(number, value)
        elif kind == "D":
            lengthy(number, struct.pack(f"<{len(value)}d", *value))
        elif kind == "S":
            for text in value:
                lengthy(number, text.encode())
        elif isinstance(kind, list):
            for one in value:
                lengthy(number, _encoded(one))
        else:
            lengthy(number, _encoded(value))
    return bytes(out)


def _decoded(message: type[M], data: bytes) -> M:
    fields, out, at, end = _fields(message), message(), 0, len(data)  # type: ignore[arg-type]

    def varint() -> int:
        nonlocal at
        value = shift = 0
        while True:
            byte = data[at]
            at += 1
            value |= (byte & 0x7F) << shift
            if byte < 0x80:
                return value
            shift += 7

    while at < end:
        key = varint()
        name, kind = fields.get(key >> 3, (None, None))
        wire = key & 7
        if wire == 0:
            value: Any = varint()
            value = bool(value) if kind == "b" else value
        elif wire == 1:
            (value,) = struct.unpack_from("<Q" if kind == "h" else "<d", data, at)
            at += 8
        elif wire == 2:
            length = varint()
            value = data[at : at + length]
            at += length
        elif wire == 5:
            at += 4
            continue
        else:
            raise ServerError("the server's bytes are no message; is it of another version?")
        if name is None:
            continue
        if kind in ("s", "S"):
            value = value.decode()
        elif kind == "D":
            value = list(struct.unpack(f"<{len(value) // 8}d", value))
        elif isinstance(kind, list):
            value = _decoded(kind[0], value)
        elif isinstance(kind, type):
            value = _decoded(kind, value)
        if kind == "S" or isinstance(kind, list):
            getattr(out, name).append(value)
        else:
            setattr(out, name, value)
    return out


@dataclass_transform()
def _message(message: type[M]) -> type[M]:
    return dataclasses.dataclass(slots=True)(message)


# ---- What the server says ------------------------------------------------------------------------------------------


@_message
class Nothing:
    """A message without fields."""


@_message
class Mount:
    r_enu_m: list[float] = _field(1, "D", list)
    az_el_rad: list[float] = _field(2, "D", list)
    az_el_rates_radps: list[float] = _field(3, "D", list)
    measured_az_el_rad: list[float] = _field(4, "D", list)
    measured_az_el_rates_radps: list[float] = _field(5, "D", list)
    mirror_rad: list[float] = _field(6, "D", list)
    mirror_at_stop: bool = _field(7, "b", False)
    base_tilt_enu_rad: list[float] = _field(8, "D", list)
    commanded_az_el_rates_radps: list[float] = _field(9, "D", list)
    commanded_mirror_rad: list[float] = _field(10, "D", list)
    laser_axis_enu: list[float] = _field(11, "D", list)
    believed_axis_enu: list[float] = _field(12, "D", list)


@_message
class Beam:
    firing: bool = _field(1, "b", False)
    fires_next: bool = _field(2, "b", False)
    interlocks: list[str] = _field(3, "S", list)
    aimed: int | None = _field(4, "u")
    power_at_target_w: float = _field(5, "d", 0.0)
    power_in_bucket_w: float = _field(6, "d", 0.0)
    irradiance_wpm2: float = _field(7, "d", 0.0)
    spot_radius_m: float = _field(8, "d", 0.0)
    offset_m: float = _field(9, "d", 0.0)
    on_aim_point: bool = _field(10, "b", False)
    transmittance: float = _field(11, "d", 0.0)
    scintillation: float = _field(12, "d", 0.0)
    energy_j: float = _field(13, "d", 0.0)
    dwell_s: float = _field(14, "d", 0.0)
    peak_wpm2: float = _field(15, "d", 0.0)


@_message
class Track:
    id: int = _field(1, "u", 0)
    is_target: bool = _field(2, "b", False)
    az_el_rad: list[float] = _field(3, "D", list)
    sigma_az_el_rad: list[float] = _field(4, "D", list)
    az_el_rates_radps: list[float] = _field(5, "D", list)
    range_m: float | None = _field(6, "d")
    sigma_range_m: float | None = _field(7, "d")
    r_enu_m: list[float] = _field(8, "D", list)
    v_enu_mps: list[float] = _field(9, "D", list)
    uav_probability: float = _field(10, "d", 0.0)
    size_rad: float = _field(11, "d", 0.0)
    hits: int = _field(12, "u", 0)


@_message
class Station:
    name: str = _field(1, "s", "")
    state: str = _field(2, "s", "")
    law: str = _field(3, "s", "")
    mount: Mount | None = _field(4, Mount)
    beam: Beam | None = _field(5, Beam)
    tracks: list[Track] = _field(6, [Track], list)
    target: int | None = _field(7, "u")
    target_uav_probability: float | None = _field(8, "d")


@_message
class Uav:
    name: str = _field(1, "s", "")
    index: int = _field(2, "u", 0)
    distractor: bool = _field(3, "b", False)
    status: str = _field(4, "s", "")
    r_enu_m: list[float] = _field(5, "D", list)
    v_enu_mps: list[float] = _field(6, "D", list)
    q_enu_body: list[float] = _field(7, "D", list)
    aim_enu_m: list[float] = _field(8, "D", list)
    skin_k: float | None = _field(9, "d")
    acquired_s: float | None = _field(10, "d")
    neutralised_s: float | None = _field(11, "d")
    at_asset_s: float | None = _field(12, "d")
    face_k: float | None = _field(13, "d")
    hole_m2: float = _field(14, "d", 0.0)
    lost: list[str] = _field(15, "S", list)


@_message
class Air:
    wind_speed_mps: float = _field(1, "d", 0.0)
    wind_from_rad: float = _field(2, "d", 0.0)
    visibility_m: float = _field(3, "d", 0.0)
    temperature_k: float = _field(4, "d", 0.0)
    cloud_cover: float = _field(5, "d", 0.0)
    precipitation_mmph: float = _field(6, "d", 0.0)


@_message
class State:
    tick: int = _field(1, "u", 0)
    t_s: float = _field(2, "d", 0.0)
    state_hash: int = _field(3, "h", 0)
    over: bool = _field(4, "b", False)
    paused: bool = _field(5, "b", False)
    stations: list[Station] = _field(6, [Station], list)
    uavs: list[Uav] = _field(7, [Uav], list)
    air: Air | None = _field(8, Air)
    late_ticks: int = _field(9, "u", 0)
    most_late_s: float = _field(10, "d", 0.0)


@_message
class Stepped:
    tick: int = _field(1, "u", 0)
    state_hash: int = _field(2, "h", 0)
    over: bool = _field(3, "b", False)
    state: State | None = _field(4, State)


@_message
class Camera:
    name: str = _field(1, "s", "")
    station: str = _field(2, "s", "")
    index: int = _field(3, "u", 0)
    tier: str = _field(4, "s", "")
    width_px: int = _field(5, "u", 0)
    height_px: int = _field(6, "u", 0)
    focal_px: float = _field(7, "d", 0.0)
    period_ticks: int = _field(8, "u", 0)


@_message
class Welcome:
    version: int = _field(1, "u", 0)
    program: str = _field(2, "s", "")
    scenario: str = _field(3, "s", "")
    seed: int = _field(4, "u", 0)
    tick_hz: int = _field(5, "u", 0)
    last_tick: int = _field(6, "u", 0)
    stations: list[str] = _field(7, "S", list)
    uavs: list[str] = _field(8, "S", list)
    cameras: list[Camera] = _field(9, [Camera], list)
    pace: float | None = _field(10, "d")
    pictures: bool = _field(11, "b", False)
    outside_detector: bool = _field(12, "b", False)


@_message
class InFrame:
    uav: int = _field(1, "u", 0)
    distractor: bool = _field(2, "b", False)
    box_px: list[float] = _field(3, "D", list)
    aim_px: list[float] = _field(4, "D", list)
    range_m: float = _field(5, "d", 0.0)
    clear: bool = _field(6, "b", False)
    visible_box_px: list[float] = _field(7, "D", list)
    visible_fraction: float | None = _field(8, "d")


@_message
class Frame:
    camera: str = _field(1, "s", "")
    index: int = _field(2, "u", 0)
    tier: str = _field(3, "s", "")
    tick: int = _field(4, "u", 0)
    number: int = _field(5, "u", 0)
    x_px: int = _field(6, "u", 0)
    y_px: int = _field(7, "u", 0)
    width_px: int = _field(8, "u", 0)
    height_px: int = _field(9, "u", 0)
    rgb8: bytes = _field(10, "y", b"")
    r_enu_m: list[float] = _field(11, "D", list)
    q_enu_cam: list[float] = _field(12, "D", list)
    believed_q_enu_cam: list[float] = _field(13, "D", list)
    focal_px: float = _field(14, "d", 0.0)
    exposure_s: float = _field(15, "d", 0.0)
    truth: list[InFrame] = _field(16, [InFrame], list)


@_message
class Frames:
    frames: list[Frame] = _field(1, [Frame], list)


@_message
class StateChange:
    to: str = _field(1, "s", "")
    reason: str = _field(2, "s", "")


@_message
class OrderAnswer:
    order: str = _field(1, "s", "")
    answer: str = _field(2, "s", "")
    reason: str = _field(3, "s", "")


@_message
class Event:
    """One of state, order, fire, uav and at_asset is there."""

    tick: int = _field(1, "u", 0)
    t_s: float = _field(2, "d", 0.0)
    of: str = _field(3, "s", "")
    state: StateChange | None = _field(4, StateChange)
    order: OrderAnswer | None = _field(5, OrderAnswer)
    fire: bool | None = _field(6, "b")
    uav: str | None = _field(7, "s")
    at_asset: bool | None = _field(8, "b")


@_message
class Events:
    events: list[Event] = _field(1, [Event], list)
    next: int = _field(2, "u", 0)
    end: int = _field(3, "u", 0)
    lost: int = _field(4, "u", 0)


@_message
class Finished:
    tick: int = _field(1, "u", 0)
    state_hash: int = _field(2, "h", 0)
    outcome: str = _field(3, "s", "")
    reason: str = _field(4, "s", "")
    folder: str = _field(5, "s", "")


@_message
class Snapshot:
    number: int = _field(1, "u", 0)
    tick: int = _field(2, "u", 0)


@_message
class Question:
    question: int = _field(1, "u", 0)
    frame: Frame | None = _field(2, Frame)
    x_px: int = _field(3, "u", 0)
    y_px: int = _field(4, "u", 0)
    width_px: int = _field(5, "u", 0)
    height_px: int = _field(6, "u", 0)


# ---- What a client wants -------------------------------------------------------------------------------------------


@_message
class Slew:
    azimuth_deg: float = _field(1, "d", 0.0)
    elevation_deg: float = _field(2, "d", 0.0)


@_message
class Pid:
    kp: float = _field(1, "d", 0.0)
    ki_per_s: float = _field(2, "d", 0.0)
    kd_s: float = _field(3, "d", 0.0)


@_message
class Gains:
    coarse: Pid | None = _field(1, Pid)
    precise: Pid | None = _field(2, Pid)
    gimbal_per_s: float | None = _field(3, "d")


@_message
class Weather:
    wind_speed_mps: float | None = _field(1, "d")
    wind_from_deg: float | None = _field(2, "d")
    visibility_m: float | None = _field(3, "d")


@_message
class AzElRates:
    azimuth_degps: float = _field(1, "d", 0.0)
    elevation_degps: float = _field(2, "d", 0.0)


@_message
class Deflection:
    right_urad: float = _field(1, "d", 0.0)
    up_urad: float = _field(2, "d", 0.0)


@_message
class Drive:
    rates: AzElRates | None = _field(1, AzElRates)
    mirror: Deflection | None = _field(2, Deflection)


@_message
class Goal:
    """Where a UAV flies: one of path, velocity, landing and rotors; without any it stops and stays."""

    uav: str = _field(1, "s", "")
    path_enu_m: list[float] = _field(2, "D", list)
    speed_mps: float | None = _field(3, "d")
    velocity_enu_mps: list[float] = _field(4, "D", list)
    land: bool = _field(5, "b", False)
    rotors: list[float] = _field(6, "D", list)
    heading_deg: float | None = _field(7, "d")


@_message
class CameraSetting:
    """How a camera exposes: a time, or `automatic=True`."""

    camera: str = _field(1, "s", "")
    exposure_s: float | None = _field(2, "d")
    automatic: bool | None = _field(3, "b")
    exposure_level: float | None = _field(4, "d")


@_message
class Order:
    """One of the orders, from `t_s` on, to one station or to all. `release=Nothing()` leaves the choice to the tracker."""

    t_s: float = _field(1, "d", 0.0)
    station: str | None = _field(2, "s")
    designate: str | None = _field(3, "s")
    track: int | None = _field(4, "u")
    release: Nothing | None = _field(5, Nothing)
    fire: bool | None = _field(6, "b")
    slew: Slew | None = _field(7, Slew)
    law: str | None = _field(8, "s")
    gains: Gains | None = _field(9, Gains)
    weather: Weather | None = _field(10, Weather)
    drive: Drive | None = _field(11, Drive)
    goal: Goal | None = _field(12, Goal)
    camera: CameraSetting | None = _field(13, CameraSetting)


@_message
class Box:
    """A detection; its class is one of those that lockstep.proto names."""

    box_px: list[float] = _field(1, "D", list)
    score: float = _field(2, "d", 0.0)
    class_: str = _field(3, "s", "")


@_message
class _Hello:
    version: int = _field(1, "u", VERSION)
    token: str = _field(2, "s", "")
    name: str = _field(3, "s", "")


@_message
class _GetFrames:
    cameras: list[str] = _field(1, "S", list)
    pixels: bool = _field(2, "b", False)
    after_tick: int = _field(3, "u", 0)


@_message
class _Step:
    ticks: int = _field(1, "u", 0)
    with_state: bool = _field(2, "b", False)


@_message
class _RunUntil:
    t_s: float = _field(1, "d", 0.0)
    with_state: bool = _field(2, "b", False)


@_message
class _GetEvents:
    from_: int = _field(1, "u", 0)


@_message
class _BeDetector:
    pixels: bool = _field(1, "b", False)
    truth: bool = _field(2, "b", False)


@_message
class _Detected:
    question: int = _field(1, "u", 0)
    boxes: list[Box] = _field(2, [Box], list)


@_message
class _Request:
    id: int = _field(1, "u", 0)
    hello: _Hello | None = _field(2, _Hello)
    ping: Nothing | None = _field(3, Nothing)
    state: Nothing | None = _field(4, Nothing)
    frames: _GetFrames | None = _field(5, _GetFrames)
    step: _Step | None = _field(6, _Step)
    run_until: _RunUntil | None = _field(7, _RunUntil)
    pause: Nothing | None = _field(8, Nothing)
    resume: Nothing | None = _field(9, Nothing)
    order: Order | None = _field(10, Order)
    seek: _Step | None = _field(11, _Step)
    scenario: Nothing | None = _field(12, Nothing)
    events: _GetEvents | None = _field(13, _GetEvents)
    finish: Nothing | None = _field(14, Nothing)
    be_detector: _BeDetector | None = _field(15, _BeDetector)
    detected: _Detected | None = _field(16, _Detected)
    take_snapshot: Nothing | None = _field(17, Nothing)
    restore: _Step | None = _field(18, _Step)


@_message
class _Text:
    text: str = _field(1, "s", "")


@_message
class _Done:
    tick: int = _field(1, "u", 0)


@_message
class _Reply:
    id: int = _field(1, "u", 0)
    error: _Text | None = _field(2, _Text)
    welcome: Welcome | None = _field(3, Welcome)
    pong: Nothing | None = _field(4, Nothing)
    state: State | None = _field(5, State)
    frames: Frames | None = _field(6, Frames)
    stepped: Stepped | None = _field(7, Stepped)
    done: _Done | None = _field(8, _Done)
    scenario: _Text | None = _field(9, _Text)
    events: Events | None = _field(10, Events)
    finished: Finished | None = _field(11, Finished)
    question: Question | None = _field(12, Question)
    snapshot: Snapshot | None = _field(13, Snapshot)


# ---- The client ----------------------------------------------------------------------------------------------------


def _there(message: M | None) -> M:
    """What a reply holds if it is the one that was asked for."""
    if message is None:
        raise ServerError("the server's reply lacks what was asked for; is it of another version?")
    return message


class Run:
    """A run that `boresight serve` serves: at an address with its port, or at the path of a Unix socket."""

    def __init__(self, at: str = "127.0.0.1:7878", *, token: str = "", name: str = "python") -> None:
        if "/" in at:
            self._socket = socket.socket(socket.AF_UNIX)
            where: Any = at
        else:
            host, _, port = at.rpartition(":")
            family, kind, *_, where = socket.getaddrinfo(host.strip("[]"), int(port), type=socket.SOCK_STREAM)[0]
            self._socket = socket.socket(family, kind)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        try:
            self._socket.connect(where)
        except OSError as error:
            self._socket.close()
            raise ServerError(f"cannot reach {at}: {error}; does `boresight serve` listen there?") from error
        self._waiting = bytearray()
        self._last_id = 0
        self._look: Callable[[Question], Sequence[Box]] | None = None
        #: What the server said at the beginning: ticks a second, names, cameras.
        self.welcome: Welcome = _there(self._ask(hello=_Hello(token=token, name=name)).welcome)

    def __enter__(self) -> Run:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Leaves the run as it is, for others."""
        self._socket.close()

    def ping(self) -> None:
        """Waits for a reply and nothing else."""
        self._ask(ping=Nothing())

    def state(self) -> State:
        """The run as its last tick left it."""
        return _there(self._ask(state=Nothing()).state)

    def frames(self, *, pixels: bool = False, cameras: Sequence[str] = (), after_tick: int = 0) -> list[Frame]:
        """The newest frame of each camera, with its truth, and its pixels where the run renders."""
        return _there(self._ask(frames=_GetFrames(list(cameras), pixels, after_tick)).frames).frames

    def step(self, ticks: int = 1, *, state: bool = False) -> Stepped:
        """Lets ticks pass."""
        return _there(self._ask(step=_Step(ticks, state)).stepped)

    def run_until(self, t_s: float, *, state: bool = False) -> Stepped:
        """Lets time pass until a simulated time."""
        return _there(self._ask(run_until=_RunUntil(t_s, state)).stepped)

    def seek(self, tick: int, *, state: bool = False) -> Stepped:
        """Goes to a tick, back or on; orders given at or after it are forgotten."""
        return _there(self._ask(seek=_Step(tick, state)).stepped)

    def snapshot(self) -> Snapshot:
        """Keeps the run's state, to go back to; the newest 64 are kept."""
        return _there(self._ask(take_snapshot=Nothing()).snapshot)

    def restore(self, snapshot: Snapshot, *, state: bool = False) -> Stepped:
        """Goes back to a snapshot; orders and events after it are forgotten. A recorded run refuses."""
        return _there(self._ask(restore=_Step(snapshot.number, state)).stepped)

    def pause(self) -> None:
        """Holds the run."""
        self._ask(pause=Nothing())

    def resume(self) -> None:
        """Lets it go on."""
        self._ask(resume=Nothing())

    def order(self, order: Order) -> None:
        """Gives an order; what becomes of it is an event."""
        self._ask(order=order)

    def scenario(self) -> str:
        """The scenario, as TOML, that repeats the run without clients."""
        return _there(self._ask(scenario=Nothing()).scenario).text

    def events(self, first: int = 0) -> Events:
        """What has happened, from an event's number on."""
        return _there(self._ask(events=_GetEvents(first)).events)

    def detect(
        self, look: Callable[[Question], Sequence[Box]], *, pixels: bool = True, truth: bool = False
    ) -> None:
        """Is the run's detector from now on; frames are looked at while this client waits for a reply."""
        self._look = look
        self._ask(be_detector=_BeDetector(pixels, truth))

    def finish(self) -> Finished:
        """Ends run and server."""
        return _there(self._ask(finish=Nothing()).finished)

    def _send(self, **what: Any) -> int:
        self._last_id += 1
        data = _encoded(_Request(id=self._last_id, **what))
        self._socket.sendall(struct.pack("<I", len(data)) + data)
        return self._last_id

    def _ask(self, **what: Any) -> _Reply:
        try:
            own = self._send(**what)
        except BrokenPipeError:
            # What the server said before it closed the connection says more.
            own = self._last_id
        while True:
            reply = self._receive()
            if reply.question is not None:
                if self._look is None:
                    raise ServerError("the server asks for detections, and nothing looks: call detect")
                self._send(detected=_Detected(reply.question.question, list(self._look(reply.question))))
            elif reply.error is not None:
                raise ServerError(reply.error.text)
            elif reply.id == own:
                return reply

    def _receive(self) -> _Reply:
        (length,) = struct.unpack("<I", self._take(4))
        if length > MOST_REPLY_BYTES:
            raise ServerError(f"a message of {length} bytes is announced, at most {MOST_REPLY_BYTES} are read")
        return _decoded(_Reply, self._take(length))

    def _take(self, count: int) -> bytes:
        while len(self._waiting) < count:
            data = self._socket.recv(max(65536, count - len(self._waiting)))
            if not data:
                raise ServerError("the server has closed the connection")
            self._waiting += data
        taken = bytes(self._waiting[:count])
        del self._waiting[:count]
        return taken
