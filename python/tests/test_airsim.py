"""AirSim's own clients, unmodified, on `boresight serve --airsim`: they fly, look, collect pictures and boxes.

`cosysairsim` and `airsim` are taken where they are installed; a client that is not there is left out.
"""

import importlib
import io
import math
import signal
import subprocess
import sys
import time
import zlib
from contextlib import contextmanager

import numpy as np
import pytest

import boresight

SCENARIO = "tests/data/airsim.toml"
HZ = 960.0
#: What stands for the distance of the sky [m].
SKY_M = 65_504.0
#: Where the scenario puts its UAVs: north, east, down of the site's origin [m].
ALPHA, BRAVO = (40.0, 0.0, -52.0), (60.0, 12.0, -55.0)


@contextmanager
def served(*options, scenario=SCENARIO):
    words = [sys.executable, "-m", "boresight", "serve", scenario, "--airsim", "127.0.0.1:0", *options]
    server = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
    try:
        for line in server.stderr:
            if line.startswith("airsim "):
                yield int(line.rsplit(":", 1)[1]), server
                break
        else:
            pytest.fail("the server does not listen")
    finally:
        if server.poll() is None:
            server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)


@pytest.fixture(params=["cosysairsim", "airsim"])
def airsim(request):
    return pytest.importorskip(request.param)


@contextmanager
def flown(airsim, *options, paused=True):
    """A client that has both UAVs in its hands, of a run that stands still."""
    with served(*options) as (port, server):
        client = airsim.MultirotorClient(port=port, timeout_value=300)
        client.confirmConnection()
        client.simPause(paused)
        for name in client.listVehicles():
            client.enableApiControl(True, name)
            client.armDisarm(True, name)
        yield client
        client.client.close()


def refused(work, words):
    with pytest.raises(Exception) as raised:
        work()
    said = str(raised.value)
    assert words in said and "\n" not in said, said


def done(client, future, longest_s=60.0, step_s=0.25):
    """Lets time pass, while the run is paused, until a task is at its end; whether it was done."""
    for _ in range(int(longest_s / step_s)):
        client.simContinueForTime(step_s)
        if future._set_flag:
            return future.get()
    pytest.fail("the task does not end")


def near(vector, wanted, within):
    found = np.array([vector.x_val, vector.y_val, vector.z_val])
    return np.linalg.norm(found - np.array(wanted)) <= within


def png(data):
    """Red, green and blue of a PNG, by no library but Python's own."""
    assert data[:8] == b"\x89PNG\r\n\x1a\n"
    at, body, width, height = 8, b"", 0, 0
    while at < len(data):
        length, kind = int.from_bytes(data[at : at + 4], "big"), data[at + 4 : at + 8]
        chunk = data[at + 8 : at + 8 + length]
        if kind == b"IHDR":
            width, height = int.from_bytes(chunk[:4], "big"), int.from_bytes(chunk[4:8], "big")
            assert chunk[8:10] == b"\x08\x02", "8 bits of red, green and blue"
        if kind == b"IDAT":
            body += chunk
        at += 12 + length
    rows = np.frombuffer(zlib.decompress(body), np.uint8).reshape(height, 1 + 3 * width)
    out = np.zeros((height, 3 * width), np.uint8)
    for y, row in enumerate(rows):
        line, above = row[1:].astype(int), out[y - 1].astype(int) if y else np.zeros(3 * width, int)
        match row[0]:
            case 0:
                out[y] = line
            case 1:
                out[y] = np.cumsum(line.reshape(width, 3), axis=0).reshape(-1) % 256
            case 2:
                out[y] = (line + above) % 256
            case other:
                for i in range(3 * width):
                    left = int(out[y, i - 3]) if i >= 3 else 0
                    corner = int(above[i - 3]) if i >= 3 else 0
                    guess = (left + int(above[i])) // 2
                    if other == 4:
                        p = left + int(above[i]) - corner
                        guess = min((left, int(above[i]), corner), key=lambda x: abs(p - x))
                    out[y, i] = (line[i] + guess) % 256
    return out.reshape(height, width, 3)


def test_a_client_finds_vehicles_cameras_and_time(airsim):
    with flown(airsim) as client:
        assert client.ping() and client.listVehicles() == ["alpha", "bravo"]
        assert client.isApiControlEnabled("bravo") and client.simIsPause()
        # Time stands still, and goes on as far as it is let.
        state = client.getMultirotorState()
        assert client.getMultirotorState().timestamp == state.timestamp
        client.simContinueForTime(0.5)
        later = client.getMultirotorState()
        assert later.timestamp - state.timestamp == 500_000_000 and client.simIsPause()
        client.simContinueForFrames(3)
        assert client.getMultirotorState().timestamp % round(1e9 / 30) <= 30
        client.enableApiControl(False, "bravo")
        assert not client.isApiControlEnabled("bravo")
        refused(lambda: client.getMultirotorState("charly"), "no vehicle 'charly': there are alpha, bravo")
        refused(lambda: client.simGetCameraInfo("front_center"), "no camera 'front_center': there are 0 (")
        refused(lambda: client.hoverAsync("bravo").join() or client.hoverAsync("bravo").get(), "call enableApiControl(True)")


def test_each_vehicle_has_its_own_frame_and_the_world_is_about_the_site(airsim):
    with flown(airsim) as client:
        for name, place in [("alpha", ALPHA), ("bravo", BRAVO)]:
            own, world = client.simGetVehiclePose(name), client.simGetObjectPose(name)
            assert near(own.position, (0, 0, 0), 0.1)
            assert near(world.position, place, 0.1)
        # A metre of the vehicle's frame is one of the world's: 5 m to the east and 3 m up.
        assert done(client, client.moveToPositionAsync(0, 5, -3, 3, vehicle_name="alpha"))
        assert near(client.simGetVehiclePose("alpha").position, (0, 5, -3), 0.7)
        assert near(client.simGetObjectPose("alpha").position, (40, 5, -55), 0.7)
        assert math.isnan(client.simGetObjectPose("nobody").position.x_val)
        # The Earth's: north is up the meridian.
        home, gps = client.getHomeGeoPoint("alpha"), client.getGpsData("", "alpha")
        east_m = (gps.gnss.geo_point.longitude - home.longitude) * math.cos(math.radians(home.latitude)) * 111_320
        assert abs(east_m - 5) < 0.8 and abs(gps.gnss.geo_point.altitude - home.altitude - 3) < 0.8
        # At rest the accelerometer feels what carries it.
        client.simContinueForTime(3)
        imu = client.getImuData("", "alpha")
        assert abs(imu.linear_acceleration.z_val + 9.81) < 0.5
        baro = client.getBarometerData("", "alpha")
        assert abs(baro.altitude - gps.gnss.geo_point.altitude) < 0.5 and 90_000 < baro.pressure < 102_000
        field = client.getMagnetometerData("", "alpha").magnetic_field_body
        assert 0.3 < math.hypot(field.x_val, field.y_val, field.z_val) < 0.62


def test_a_vehicle_flies_as_it_is_told(airsim):
    yaw = airsim.YawMode
    free, ahead = airsim.DrivetrainType.MaxDegreeOfFreedom, airsim.DrivetrainType.ForwardOnly
    with flown(airsim) as client:

        def at():
            return client.simGetVehiclePose("alpha").position

        assert done(client, client.takeoffAsync(vehicle_name="alpha"))
        path = [airsim.Vector3r(8, 0, -4), airsim.Vector3r(8, 8, -4)]
        assert done(client, client.moveOnPathAsync(path, 4, 60, ahead, yaw(False, 0), vehicle_name="alpha"))
        assert near(at(), (8, 8, -4), 0.7)
        # A velocity for two seconds, then it stops.
        before = at()
        assert done(client, client.moveByVelocityAsync(0, -3, 0, 2, free, yaw(True, 0), vehicle_name="alpha"))
        client.simContinueForTime(4)
        moved = at() - before
        assert -9 < moved.y_val < -3.5 and abs(moved.x_val) < 0.7 and abs(moved.z_val) < 0.7
        speed = client.simGetGroundTruthKinematics("alpha").linear_velocity
        assert near(speed, (0, 0, 0), 0.4)
        # The nose to the east, and ahead of it.
        assert done(client, client.rotateToYawAsync(90, 30, 3, vehicle_name="alpha"))
        facing = airsim.to_eularian_angles if hasattr(airsim, "to_eularian_angles") else airsim.quaternion_to_euler_angles
        assert abs(math.degrees(facing(client.simGetVehiclePose("alpha").orientation)[2]) - 90) < 4
        before = at()
        done(client, client.moveByVelocityBodyFrameAsync(3, 0, 0, 2, free, yaw(True, 0), vehicle_name="alpha"))
        client.simContinueForTime(3)
        moved = at() - before
        assert 3.5 < moved.y_val < 9 and abs(moved.x_val) < 1
        # A height is held on the way.
        done(client, client.moveByVelocityZAsync(2, 0, -8, 6, free, yaw(True, 0), vehicle_name="alpha"))
        assert abs(at().z_val + 8) < 0.5
        assert done(client, client.moveToZAsync(-3, 2, vehicle_name="alpha")) and abs(at().z_val + 3) < 0.7
        # Another order takes the place of one, which was then not done.
        long = client.moveToPositionAsync(500, 0, -3, 5, vehicle_name="alpha")
        client.simContinueForTime(1)
        assert done(client, client.hoverAsync("alpha")) and long.get() is False
        # So does a time that is over.
        assert done(client, client.moveToPositionAsync(500, 0, -3, 5, timeout_sec=1, vehicle_name="alpha")) is False
        long = client.moveToPositionAsync(500, 0, -3, 5, vehicle_name="alpha")
        client.simContinueForTime(0.5)
        client.cancelLastTask("alpha")
        assert long.get() is False
        assert done(client, client.goHomeAsync(vehicle_name="alpha")) and near(at(), (0, 0, 0), 0.7)
        refused(
            lambda: client.moveByVelocityAsync(1, 0, 0, 1, free, yaw(True, 20), vehicle_name="alpha").get(),
            "a rate of yaw is not offered",
        )
        refused(lambda: client.moveToPositionAsync(1e9, 0, 0, 5, vehicle_name="alpha").get(), "path_enu_m[0]")


def test_a_landed_vehicle_says_so_and_takes_off_again(airsim):
    with flown(airsim) as client:
        assert client.getMultirotorState("alpha").landed_state == airsim.LandedState.Flying
        assert done(client, client.landAsync(120, "alpha"), 120)
        assert client.getMultirotorState("alpha").landed_state == airsim.LandedState.Landed
        low = client.simGetVehiclePose("alpha").position.z_val
        assert done(client, client.takeoffAsync(20, "alpha"))
        assert client.getMultirotorState("alpha").landed_state == airsim.LandedState.Flying
        assert abs(client.simGetVehiclePose("alpha").position.z_val - low + 3) < 0.8


def test_calls_are_answered_while_another_is_waited_for(airsim):
    with served() as (port, _):
        waits, asks = (airsim.MultirotorClient(port=port, timeout_value=120) for _ in range(2))
        waits.enableApiControl(True)
        begun = time.monotonic()
        future = waits.moveByVelocityAsync(1, 0, 0, 1.5)
        asked = 0
        while not asks.simIsPause() and time.monotonic() - begun < 1.2:
            assert asks.getMultirotorState().timestamp > 0
            asked += 1
        future.join()
        # By the clock: 1.5 s take about as long.
        assert asked > 20 and 1.3 < time.monotonic() - begun < 6


def test_reset_begins_anew(airsim):
    with flown(airsim) as client:
        done(client, client.moveToPositionAsync(6, 0, 0, 4))
        client.reset()
        client.simPause(True)
        assert not client.isApiControlEnabled()
        pose = client.simGetVehiclePose()
        assert near(pose.position, (0, 0, 0), 1.0)


def test_pictures_are_those_of_the_camera(airsim):
    with flown(airsim) as client:
        client.simContinueForTime(2)
        kinds = airsim.ImageType
        requests = [
            airsim.ImageRequest("0", kinds.Scene),
            airsim.ImageRequest("0", kinds.Scene, False, False),
            airsim.ImageRequest("0", kinds.DepthPlanar, True),
            airsim.ImageRequest("0", kinds.DepthPerspective, True),
            airsim.ImageRequest("0", kinds.DepthVis),
            airsim.ImageRequest("0", kinds.Segmentation, False, False),
            airsim.ImageRequest("0", kinds.SurfaceNormals, False, False),
        ]
        scene, raw, planar, far, vis, ids, normals = client.simGetImages(requests)
        assert all((of.width, of.height) == (256, 144) for of in (scene, raw, planar, far, vis, ids, normals))
        assert len({of.time_stamp for of in (scene, raw, planar, ids)}) == 1
        picture = png(bytes(scene.image_data_uint8))
        bgr = np.frombuffer(raw.image_data_uint8, np.uint8).reshape(144, 256, 3)
        assert np.array_equal(picture, bgr[:, :, ::-1]) and picture.std() > 10
        assert client.simGetImage("0", kinds.Scene) == bytes(scene.image_data_uint8)

        z = np.array(planar.image_data_float).reshape(144, 256)
        r = np.array(far.image_data_float).reshape(144, 256)
        sky = z == SKY_M
        assert 0.05 < sky.mean() < 0.95 and (r[~sky] >= z[~sky] - 1e-3).all() and z[~sky].min() > 1
        # Along a ray, distance and distance ahead stand as the pinhole says.
        focal = 128 / math.tan(math.radians(client.simGetCameraInfo("0").fov) / 2)
        x, y = np.meshgrid(np.arange(256) + 0.5 - 128, np.arange(144) + 0.5 - 72)
        slant = np.sqrt(1 + (x / focal) ** 2 + (y / focal) ** 2)
        assert np.allclose(r[~sky], (z * slant)[~sky], rtol=1e-4)
        grey = png(bytes(vis.image_data_uint8))
        assert np.abs(grey[:, :, 0] - 255 * np.minimum(z / 100, 1)).max() <= 1

        # The ground's normals look up: north, east, down in blue, green, red of a raw picture.
        colours = np.frombuffer(ids.image_data_uint8, np.uint8).reshape(144, 256, 3)[:, :, ::-1]
        ground = (colours == (128, 0, 0)).all(axis=2)
        down = np.frombuffer(normals.image_data_uint8, np.uint8).reshape(144, 256, 3)[:, :, 0]
        assert ground.sum() > 50 and np.median(down[ground]) < 10
        assert (colours[sky] == 0).all()
        refused(lambda: client.simGetImage("0", kinds.Infrared), "image type 7 is not offered")
        refused(lambda: client.simGetImage("0", kinds.DepthPlanar), "pixels_as_float=True")


def test_a_uav_is_where_depth_segmentation_and_boxes_say(airsim):
    with flown(airsim) as client:
        client.simContinueForTime(6)
        kinds, names = airsim.ImageType, client.listVehicles()
        cameras = [str(number) for number in range(3)]
        held = 0
        for camera in cameras:
            client.simAddDetectionFilterMeshName(camera, kinds.Scene, "alph*")
            client.simSetDetectionFilterRadius(camera, kinds.Scene, 500 * 100)
            found = client.simGetDetections(camera, kinds.Scene)
            assert {of.name for of in found} <= {"alpha"}
            if not found:
                continue
            held += 1
            box = found[0]
            depth, ids = client.simGetImages(
                [
                    airsim.ImageRequest(camera, kinds.DepthPerspective, True),
                    airsim.ImageRequest(camera, kinds.Segmentation, True),
                ]
            )
            shape = (depth.height, depth.width)
            r, ids = (np.array(of.image_data_float).reshape(shape) for of in (depth, ids))
            own = ids == client.simGetSegmentationObjectID("alpha")
            x0, y0, x1, y1 = box.box2D.min.x_val, box.box2D.min.y_val, box.box2D.max.x_val, box.box2D.max.y_val
            if own.any():
                ys, xs = np.nonzero(own)
                # A pixel more: the box has four samples of each.
                assert xs.min() >= x0 - 1 and xs.max() + 1 <= x1 + 1 and ys.min() >= y0 - 1 and ys.max() + 1 <= y1 + 1
                info = client.simGetCameraInfo(camera)
                eye, place = info.pose.position, client.simGetObjectPose("alpha").position
                range_m = eye.distance_to(place)
                assert abs(np.median(r[own]) / range_m - 1) < 0.01
            low, high, middle = box.box3D.min, box.box3D.max, box.relative_pose.position
            assert low.x_val < middle.x_val < high.x_val and 0.2 < high.y_val - low.y_val < 1.5
        assert held >= 2, "two cameras at least hold it"
        # A number of its own.
        assert client.simSetSegmentationObjectID("alpha", 77) and client.simGetSegmentationObjectID("alpha") == 77
        assert client.simSetSegmentationObjectID("building.*", 9, True)
        assert not client.simSetSegmentationObjectID("nothing", 9) and client.simGetSegmentationObjectID("nothing") == -1
        assert set(names) < set(client.simListSceneObjects()) and client.simListSceneObjects("brav.") == ["bravo"]
        client.simClearDetectionMeshNames("0", kinds.Scene)
        assert client.simGetDetections("0", kinds.Scene) == []


def test_weather_changes_what_is_seen(airsim):
    with flown(airsim) as client:
        kinds = airsim.ImageType

        def picture():
            client.simContinueForTime(1)
            return png(client.simGetImage("0", kinds.Scene)).astype(int)

        clear = picture()
        client.simEnableWeather(True)
        client.simSetWeatherParameter(airsim.WeatherParameter.Fog, 1.0)
        foggy = picture()
        # In fog there is no colour.
        colourful = [np.ptp(of, axis=2).mean() for of in (clear, foggy)]
        assert colourful[1] < 0.3 * colourful[0], colourful
        refused(lambda: client.simSetWeatherParameter(airsim.WeatherParameter.Snow, 0.5), "there are Fog")
        client.simSetWind(airsim.Vector3r(4, 0, 0))
        refused(lambda: client.simSetWind(airsim.Vector3r(0, 0, 3)), "along the ground")
        client.simSetTimeOfDay(False)
        refused(lambda: client.simSetTimeOfDay(True), "time_utc")
        refused(lambda: client.simSetCameraFov("0", 90), "hfov_deg")
        refused(lambda: client.simSetCameraPose("0", airsim.Pose()), "station")
        refused(lambda: client.getLidarData(), "getLidarData: is not offered; docs/airsim.md")
        refused(client.startRecording, "--out FOLDER")


def test_a_run_with_a_client_repeats_without_it(airsim, tmp_path):
    out = tmp_path / "out"
    with served("--out", str(out)) as (port, _):
        client = airsim.MultirotorClient(port=port, timeout_value=120)
        client.simPause(True)
        client.enableApiControl(True)
        client.startRecording()
        assert client.isRecording()
        assert done(client, client.moveToPositionAsync(5, 3, -2, 3))
        client.simGetImage("0", airsim.ImageType.Scene)
        ended = client.getMultirotorState()
    again = boresight.Simulation(out / "scenario.toml", pictures=False)
    # Rounded up to a nanosecond, the tick's time would be the next one's.
    again.run_until((ended.timestamp - 2) / 1e9)
    place = next(uav for uav in again.uavs if uav.name == "alpha").r_enu_m
    own = ended.kinematics_estimated.position
    assert np.allclose([place[1] - 40, place[0], 52 - place[2]], [own.x_val, own.y_val, own.z_val], atol=1e-9)


def test_a_first_flight_in_the_manner_of_airsims_guides(airsim, tmp_path):
    """Connect, take off, go there, look about, come back: by the clock."""
    with served("--pace", "4") as (port, _):
        client = airsim.MultirotorClient(port=port, timeout_value=120)
        client.confirmConnection()
        client.enableApiControl(True)
        client.armDisarm(True)
        client.takeoffAsync().join()
        client.moveToPositionAsync(-5, 4, -4, 5).join()
        state = client.getMultirotorState()
        assert near(state.kinematics_estimated.position, (-5, 4, -4), 1.5)
        client.hoverAsync().join()
        kinds = airsim.ImageType
        wanted = [
            airsim.ImageRequest("0", kinds.DepthVis),
            airsim.ImageRequest("1", kinds.DepthPerspective, True),
            airsim.ImageRequest("1", kinds.Scene),
            airsim.ImageRequest("1", kinds.Scene, False, False),
        ]
        for number, answer in enumerate(client.simGetImages(wanted)):
            if answer.pixels_as_float:
                depths = airsim.get_pfm_array(answer)
                assert depths.shape == (answer.height, answer.width)
            elif answer.compress:
                file = tmp_path / f"{number}.png"
                airsim.write_file(str(file), answer.image_data_uint8)
                assert file.read_bytes()[:4] == b"\x89PNG"
            else:
                flat = np.frombuffer(answer.image_data_uint8, dtype=np.uint8)
                assert flat.reshape(answer.height, answer.width, 3).any()
        client.armDisarm(False)
        client.reset()
        client.enableApiControl(False)


def test_a_collection_of_pictures_and_boxes_in_the_manner_of_airsims_guides(airsim):
    """A data set: a frame at a time in lockstep, the pictures with the boxes of all that flies."""
    with flown(airsim) as client:
        kinds = airsim.ImageType
        client.simSetDetectionFilterRadius("0", kinds.Scene, 300 * 100)
        client.simAddDetectionFilterMeshName("0", kinds.Scene, "*")
        flight = client.moveByVelocityAsync(0, 2, 0, 3, vehicle_name="alpha")
        rows = []
        for _ in range(12):
            client.simContinueForFrames(1)
            (answer,) = client.simGetImages([airsim.ImageRequest("0", kinds.Scene, False, False)])
            boxes = client.simGetDetections("0", kinds.Scene)
            rows.append((answer.time_stamp, answer.width * answer.height * 3 == len(answer.image_data_uint8), boxes))
        stamps = [stamp for stamp, _, _ in rows]
        assert all(round((b - a) * 30 / 1e9, 3) == 1 for a, b in zip(stamps, stamps[1:]))
        assert all(whole for _, whole, _ in rows)
        names = {of.name for _, _, boxes in rows for of in boxes}
        assert names == {"alpha", "bravo"}
        client.cancelLastTask("alpha")
        assert flight.get() is False
