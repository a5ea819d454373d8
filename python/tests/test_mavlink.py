"""MAVLink by another implementation of it, pymavlink: a ground station, and an autopilot that flies a UAV in lockstep."""

import json
import math
import os
import socket
import subprocess
import sys
from contextlib import contextmanager

import numpy as np
import pytest

import boresight
from boresight import client

os.environ["MAVLINK20"] = "1"
mavutil = pytest.importorskip("pymavlink.mavutil")
common = pytest.importorskip("pymavlink.dialects.v20.common")

URBAN = "scenarios/urban_intercept.toml"
GRAVITY_MPS2 = 9.80665
EARTH_M = 6_371_000.0


@contextmanager
def served(*options):
    """A server, and what it says on standard error, line by line."""
    words = [sys.executable, "-m", "boresight", "serve", URBAN, "--listen", "127.0.0.1:0", "--no-capture"]
    words += ["--set", "detector.kind=truth", "--set", "engage.authorised=false", *options]
    server = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    try:
        yield server
    finally:
        if server.poll() is None:
            server.kill()
        server.communicate(timeout=60)


def said(server, begins):
    for line in server.stderr:
        if line.startswith(begins):
            return line.removeprefix(begins).strip()
    pytest.fail(f"nothing begins with '{begins}'")


def test_a_ground_station_sees_the_uavs_and_turns_the_gimbal():
    ground = mavutil.mavlink_connection("udpin:127.0.0.1:0", dialect="common", source_system=255)
    port = ground.port.getsockname()[1]
    with served("--mavlink", f"udpout:127.0.0.1:{port}") as server:
        address = said(server, "serve  ")

        def until(kind, wanted=lambda message: True):
            for _ in range(1_000):
                message = ground.recv_match(type=kind, blocking=True, timeout=30)
                assert message is not None, f"no {kind} comes"
                if wanted(message):
                    return message
            pytest.fail(f"no such {kind} comes")

        until("HEARTBEAT", lambda beat: beat.get_srcSystem() == 1 and beat.type == common.MAV_TYPE_QUADROTOR)
        beat = until("HEARTBEAT", lambda beat: beat.get_srcSystem() == 250)
        assert (beat.get_srcComponent(), beat.type) == (154, common.MAV_TYPE_GIMBAL)
        with client.Run(address) as run:
            tick_hz = run.welcome.tick_hz
            stepped = run.step(tick_hz, state=True)
            place = until("GLOBAL_POSITION_INT", lambda place: place.get_srcSystem() == 1 and place.time_boot_ms == 1_000)
            uav = stepped.state.uavs[0]
            assert place.lat == pytest.approx(1e7 * (47.3769 + math.degrees(uav.r_enu_m[1] / 6_367_000)), abs=200)
            assert [place.vx, place.vy, place.vz] == pytest.approx(
                [100 * uav.v_enu_mps[1], 100 * uav.v_enu_mps[0], -100 * uav.v_enu_mps[2]], abs=0.51
            )
            nan = math.nan
            ground.mav.command_long_send(
                250, 154, common.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, 0, nan, nan, 1.0, 2.0, 0, 0, 0
            )
            answer = until("COMMAND_ACK")
            assert (answer.command, answer.result) == (1000, common.MAV_RESULT_ACCEPTED)
            looks = []
            for second in (2, 3):
                run.step(tick_hz)
                status = until("GIMBAL_DEVICE_ATTITUDE_STATUS", lambda status: status.time_boot_ms == 1_000 * second)  # noqa: B023
                w, _, y, z = status.q
                looks.append((2 * math.degrees(math.atan2(y, w)), 2 * math.degrees(math.atan2(z, w))))
            # The base shakes; the mean over a second is what was wanted.
            turned = [math.remainder(after - before, 360) for before, after in zip(*looks)]
            assert turned == pytest.approx([1.0, 2.0], abs=0.05)
            ground.mav.command_long_send(1, 1, common.MAV_CMD_COMPONENT_ARM_DISARM, 0, 1, 0, 0, 0, 0, 0, 0)
            answer = until("COMMAND_ACK", lambda answer: answer.command == 400)
            assert (answer.get_srcSystem(), answer.result) == (1, common.MAV_RESULT_UNSUPPORTED)
            run.finish()


class Autopilot:
    """A cascade from place to rotor on HIL_STATE_QUATERNION. Places are north, east, down of where it took over [m]."""

    #: Gains, each some times slower than the one inside it [1/s].
    PLACE, SPEED, TILT, RATE, YAW = 0.7, 1.6, 6.0, 12.0, 3.0
    #: Angular accelerations of a difference of one in the rotors' thrust shares, roughly [rad/s²].
    ROLL_PITCH, TURN = 300.0, 25.0

    def __init__(self):
        self.start = None
        self.hover = 0.35
        self.yaw_rad = None
        self.flown = []
        #: Where it is to be from which time on [s].
        self.plan = [(0.0, np.zeros(3))]

    def controls(self, state):
        t_s = 1e-6 * state.time_usec
        if self.start is None:
            self.start = (state.lat, state.lon, state.alt)
        lat, lon, alt = self.start
        east = math.cos(math.radians(1e-7 * lat))
        place_m = np.array(
            [
                math.radians(1e-7 * (state.lat - lat)) * EARTH_M,
                math.radians(1e-7 * (state.lon - lon)) * EARTH_M * east,
                -1e-3 * (state.alt - alt),
            ]
        )
        speed_mps = 1e-2 * np.array([state.vx, state.vy, state.vz])
        self.flown.append((t_s, *place_m))
        goal_m = [goal_m for from_s, goal_m in self.plan if from_s <= t_s][-1]

        wanted_mps = self.PLACE * (goal_m - place_m)
        wanted_mps *= min(1.0, 4.0 / max(np.linalg.norm(wanted_mps), 1e-9))
        push_mps2 = np.clip(self.SPEED * (wanted_mps - speed_mps), -4.0, 4.0)
        self.hover += 0.02 / 240 * -push_mps2[2]
        down_mps2 = np.array([0.0, 0.0, GRAVITY_MPS2]) - push_mps2
        lift_mps2 = np.linalg.norm(down_mps2)

        w, x, y, z = state.attitude_quaternion
        turn = np.array(
            [
                [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
                [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
                [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
            ]
        )
        yaw_rad = math.atan2(turn[1, 0], turn[0, 0])
        self.yaw_rad = yaw_rad if self.yaw_rad is None else self.yaw_rad
        off = turn.T @ (down_mps2 / lift_mps2)
        yaw_off = math.remainder(self.yaw_rad - yaw_rad, 2 * math.pi)
        rates = np.array([-self.TILT * off[1], self.TILT * off[0], 0.5 * self.YAW * yaw_off])
        rates -= [state.rollspeed, state.pitchspeed, state.yawspeed]
        roll, pitch = self.RATE * rates[:2] / self.ROLL_PITCH
        yaw = self.YAW * rates[2] / self.TURN

        share = self.hover * lift_mps2 / GRAVITY_MPS2
        # Front right, rear left, front left, rear right.
        shares = share + np.array([-roll + pitch + yaw, roll - pitch + yaw, roll + pitch - yaw, -roll - pitch - yaw])
        # Thrust goes with the square of the speed.
        return np.sqrt(np.clip(shares, 0.0, 1.0))

    def fly(self, address):
        """Answers each HIL_SENSOR until the simulator leaves; how often."""
        host, port = address.rsplit(":", 1)
        link = socket.create_connection((host, int(port)))
        mav = common.MAVLink(None, srcSystem=1, srcComponent=1)
        state, answers = None, 0
        while True:
            try:
                data = link.recv(65_536)
            except ConnectionResetError:
                return answers
            if not data:
                return answers
            for message in mav.parse_buffer(data) or []:
                if message.get_type() == "HIL_STATE_QUATERNION":
                    state = message
                elif message.get_type() == "HIL_SENSOR":
                    assert state is not None and state.time_usec == message.time_usec
                    controls = [*self.controls(state).tolist(), *[0.0] * 12]
                    armed = common.MAV_MODE_FLAG_SAFETY_ARMED
                    answer = mav.hil_actuator_controls_encode(message.time_usec, controls, armed, 1)
                    link.sendall(answer.pack(mav))
                    answers += 1


def test_an_autopilot_outside_hovers_and_flies_ten_metres(tmp_path):
    pilot = Autopilot()
    pilot.plan = [(0.0, np.zeros(3)), (10.0, np.array([10.0, 0.0, 0.0]))]
    options = ["--hil", "intruder=tcpin:127.0.0.1:0", "--set", "duration_s=18", "--out", str(tmp_path)]
    with served(*options) as server:
        answers = pilot.fly(said(server, "hil  intruder=tcpin:"))
        assert server.wait(timeout=120) == 0
    assert answers == 18 * 240
    flown = np.array(pilot.flown)
    places_m = lambda from_s, to_s: flown[(flown[:, 0] >= from_s) & (flown[:, 0] < to_s), 1:]  # noqa: E731
    hovers_m, arrived_m = places_m(7.0, 10.0), places_m(16.0, 18.0)
    # It began at 8 m/s; gusts move it a little.
    assert np.linalg.norm(hovers_m, axis=1).max() < 0.5
    assert np.linalg.norm(arrived_m - [10.0, 0.0, 0.0], axis=1).max() < 0.5

    # The orders that came of it are in the scenario: the same run without it.
    summary = json.loads((tmp_path / "summary.json").read_text())
    with boresight.Simulation(tmp_path / "scenario.toml") as run:
        while not run.step(960):
            pass
        assert f"{run.state_hash:016x}" == summary["state_hash"]


def test_what_is_no_message_is_ignored():
    with served("--mavlink", "udpin:127.0.0.1:0") as server:
        address = said(server, "serve  ")
        host, port = said(server, "mavlink  udpin:").rsplit(":", 1)
        stranger = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        for size in (0, 1, 7, 300, 2_000):
            stranger.sendto(bytes(range(256)) * 8 if size == 2_000 else b"\xfd" * size, (host, int(port)))
        with client.Run(address) as run:
            assert run.step(96).tick == 96
            run.finish()
        assert "malformed and ignored" in said(server, "mavlink: messages ")
