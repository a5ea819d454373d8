//! Which call is answered by what.

use super::answers::{Answer, Fault, say_to};
use super::session::Session;
use super::{images, motion, queries, scene, scenery};
use crate::serve::error::ServeError;
use crate::serve::inbox::Client;
use boresight_airsim::{Arguments, Call, Value};

/// Version of AirSim's interface that is spoken; clients of 1.8 want 1 at least, those of Cosys-AirSim 3 want 4.
const SERVER_VERSION: u64 = 4;
/// The oldest client that is understood.
const CLIENT_VERSION: u64 = 1;

/// Answers a call.
pub(super) fn answer(
    mut session: Session,
    client: &Client,
    call: Call,
) -> Result<Session, ServeError> {
    let Call {
        id,
        method,
        arguments,
    } = call;
    let arguments = Arguments::new(&method, arguments);
    match carry_out(&mut session, client, id, arguments) {
        Ok(Answer::Now(value)) => say_to(client, id, value),
        Ok(Answer::Later) => {}
        Ok(Answer::Reset) => {
            session = session.reset()?;
            say_to(client, id, Value::Nil);
        }
        Err(Fault::Refused(why)) => {
            if let Some(id) = id {
                client.outbox.refuse(id.into(), why);
            }
        }
        Err(Fault::Fatal(error)) => return Err(error),
    }
    Ok(session)
}

/// Carries out a call.
fn carry_out(
    session: &mut Session,
    client: &Client,
    id: Option<u32>,
    mut of: Arguments,
) -> Result<Answer, Fault> {
    let method = of.method().to_owned();
    let now = |value: Value| Ok(Answer::Now(value));
    match method.as_str() {
        "ping" => now(true.into()),
        "getServerVersion" => now(SERVER_VERSION.into()),
        "getMinRequiredClientVersion" => now(CLIENT_VERSION.into()),
        "getSettingsString" => now(queries::settings().into()),
        "reset" => Ok(Answer::Reset),

        "simPause" => {
            let paused = of.flag("is_paused")?;
            session.pause(paused);
            now(Value::Nil)
        }
        "simIsPaused" => now(session.paused().into()),
        "simContinueForTime" => {
            let seconds = of.number("seconds")?;
            let end_s = session.view().t_s() + seconds.max(0.0);
            let ticks = session.run().ticks_until(end_s);
            Ok(session.go_on(ticks, client, id))
        }
        "simContinueForFrames" => {
            let frames = of.whole("frames")?;
            let ticks = images::ticks_of_frames(session.view(), frames);
            Ok(session.go_on(ticks, client, id))
        }

        "listVehicles" => now(queries::vehicles(session)),
        "enableApiControl" => motion::enable(session, &mut of),
        "isApiControlEnabled" => motion::is_enabled(session, &mut of),
        "armDisarm" => motion::arm(session, &mut of),
        "takeoff" | "land" | "goHome" | "hover" | "moveToPosition" | "moveToGPS" | "moveToZ"
        | "moveOnPath" | "moveByVelocity" | "moveByVelocityZ" | "moveByVelocityBodyFrame"
        | "moveByVelocityZBodyFrame" | "rotateToYaw" => {
            motion::begin(session, client, id, &mut of)
        }
        "cancelLastTask" => motion::cancel(session, &mut of),

        "getMultirotorState" => queries::multirotor(session, &mut of),
        "simGetVehiclePose" => queries::vehicle_pose(session, &mut of),
        "simGetGroundTruthKinematics" | "simGetPhysicsRawKinematics" => {
            queries::kinematics(session, &mut of)
        }
        "simGetGroundTruthEnvironment" => queries::environment(session, &mut of),
        "simGetCollisionInfo" => queries::collision(session, &mut of),
        "getHomeGeoPoint" => queries::home(session, &mut of),
        "getGpsData" | "getImuData" | "getBarometerData" | "getMagnetometerData" => {
            queries::sensor(session, &mut of)
        }
        "simTestLineOfSightToPoint" | "simTestLineOfSightBetweenPoints" => {
            queries::line_of_sight(session, &mut of)
        }

        "simListSceneObjects" => scenery::list(session, &mut of),
        "simGetObjectPose" => scenery::pose(session, &mut of),
        "simGetSegmentationObjectID" => scenery::id(session, &mut of),
        "simSetSegmentationObjectID" => scenery::set_id(session, &mut of),
        "simAddDetectionFilterMeshName" => scenery::add_filter(session, &mut of),
        "simSetDetectionFilterRadius" => scenery::set_radius(session, &mut of),
        "simClearDetectionMeshNames" => scenery::clear_filters(session, &mut of),
        "simGetDetections" => scenery::detections(session, &mut of),

        "simGetImage" => images::one(session, &mut of),
        "simGetImages" => images::several(session, &mut of),
        "simGetCameraInfo" => images::camera_info(session, &mut of),
        "simGetCurrentFieldOfView" => images::field(session, &mut of),
        "simSetCameraPose" => Err(of
            .wrong("a camera is where its station's mount turns it: order the station, or place it in the scenario")
            .into()),
        "simSetCameraFov" => Err(of
            .wrong("a camera's lens does not change while the run goes on: set hfov_deg in the scenario")
            .into()),

        "simEnableWeather" => scene::enable(session, &mut of),
        "simSetWeatherParameter" => scene::set(session, &mut of),
        "simSetWind" => scene::set_wind(session, &mut of),
        "simSetTimeOfDay" => scene::set_time(&mut of),
        "simPrintLogMessage" => scene::print(&mut of),
        "startRecording" => scene::record(session, &of),
        "stopRecording" => {
            session.recording = false;
            now(Value::Nil)
        }
        "isRecording" => now(session.recording.into()),
        _ => {
            let name: String = method.chars().filter(|c| !c.is_control()).take(60).collect();
            Err(format!("{name}: is not offered; docs/airsim.md lists the calls that are").into())
        }
    }
}
