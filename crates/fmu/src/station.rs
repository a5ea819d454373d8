//! A station of a run, as a unit steps it: inputs are orders, outputs are views.

use boresight::fmu::{Causality, FmuError, number_of, opened, reference, variable};
use boresight::models::maths::kinematics::wrap_pi;
use boresight::scenario::{DriveOrder, Loaded, OrderConfig};
use boresight::simulation::{Builder, Simulation, StationView};
use std::path::Path;

/// How far communication points may be from ticks, in ticks: what sums of steps lose.
const TOLERANCE_TICKS: f64 = 1e-3;
const URAD_PER_RAD: f64 = 1e6;

/// A value of a variable.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// A number.
    Float64(f64),
    /// Yes or no.
    Boolean(bool),
    /// A whole number.
    UInt64(u64),
    /// The number of a state.
    Int64(i64),
}

/// How far a unit is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Phase {
    Instantiated,
    Initializing,
    Steps,
    Terminated,
}

/// What the importer sets.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Inputs {
    drive: bool,
    /// Rates of azimuth and elevation [rad/s].
    rates_radps: [f64; 2],
    /// Deflection right and up [rad].
    mirror_rad: [f64; 2],
    fire: bool,
}

impl Inputs {
    fn start(loaded: &Loaded) -> Self {
        Self {
            drive: false,
            rates_radps: [0.0; 2],
            mirror_rad: [0.0; 2],
            fire: loaded.scenario.engage.authorised,
        }
    }

    /// What drives gimbal and mirror.
    fn driven(&self) -> DriveOrder {
        match self.drive {
            false => DriveOrder::default(),
            true => DriveOrder {
                rates_degps: Some(self.rates_radps.map(f64::to_degrees)),
                mirror_urad: Some(self.mirror_rad.map(|rad| URAD_PER_RAD * rad)),
            },
        }
    }
}

/// A unit between two calls.
pub struct Station {
    loaded: Loaded,
    name: String,
    phase: Phase,
    seed: u64,
    inputs: Inputs,
    /// What the run was last told.
    told: Inputs,
    run: Option<Simulation>,
    start_s: f64,
}

/// What a step has come to.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Stepped {
    /// Time of the importer's that was reached [s].
    pub t_s: f64,
    /// Whether the run is over.
    pub over: bool,
}

impl Station {
    /// Opens what the resources of a unit hold.
    pub fn open(resources: &Path, token: &str) -> Result<Self, FmuError> {
        let (loaded, name) = opened(resources, token)?;
        let inputs = Inputs::start(&loaded);
        Ok(Self {
            seed: loaded.scenario.seed,
            inputs,
            told: inputs,
            loaded,
            name,
            phase: Phase::Instantiated,
            run: None,
            start_s: 0.0,
        })
    }

    fn is_in(&self, wanted: Phase, so: &str) -> Result<(), String> {
        match self.phase == wanted {
            true => Ok(()),
            false => Err(format!("may be called {so} alone")),
        }
    }

    /// Begins to initialise it for a run that starts at a time of the importer's [s].
    pub fn enter_initialization(&mut self, start_s: f64) -> Result<(), String> {
        self.is_in(Phase::Instantiated, "after instantiation or reset")?;
        if !start_s.is_finite() {
            return Err("the start time is no number of seconds".to_owned());
        }
        self.start_s = start_s;
        self.phase = Phase::Initializing;
        Ok(())
    }

    /// Builds the run.
    pub fn exit_initialization(&mut self) -> Result<(), String> {
        self.is_in(Phase::Initializing, "in initialization mode")?;
        self.built()?;
        self.phase = Phase::Steps;
        Ok(())
    }

    /// The run, which is built when its seed can change no more.
    fn built(&mut self) -> Result<&mut Simulation, String> {
        let run = match self.run.take() {
            Some(run) => run,
            None => {
                let builder = Builder::loaded(self.loaded.clone()).seed(self.seed);
                let opened = builder.pictures(false).open();
                opened.map_err(|error| error.to_string())?
            }
        };
        Ok(self.run.insert(run))
    }

    /// Ends the run.
    pub fn terminate(&mut self) -> Result<(), String> {
        self.is_in(Phase::Steps, "in step mode")?;
        self.phase = Phase::Terminated;
        Ok(())
    }

    /// As it was after instantiation.
    pub fn reset(&mut self) {
        self.run = None;
        self.phase = Phase::Instantiated;
        self.seed = self.loaded.scenario.seed;
        self.inputs = Inputs::start(&self.loaded);
        self.told = self.inputs;
    }

    /// Lets time pass from a communication point to the next.
    pub fn step(&mut self, point_s: f64, step_s: f64) -> Result<Stepped, String> {
        self.is_in(Phase::Steps, "in step mode")?;
        let start_s = self.start_s;
        let (inputs, told, name) = (self.inputs, self.told, self.name.clone());
        let run = self.run.as_mut().ok_or("has no run")?;
        let tick_hz = f64::from(run.view().tick_hz());
        let ticks = whole_ticks(step_s, tick_hz)?;
        let here = (point_s - start_s) * tick_hz - run.view().tick() as f64;
        let near = here.abs() <= TOLERANCE_TICKS * (1.0 + run.view().tick() as f64).sqrt();
        if !run.over() && !near {
            return Err(format!(
                "the communication point is {point_s} s, but the run is at {} s; time goes on step by step",
                start_s + run.t_s()
            ));
        }
        if !run.over() {
            for order in orders(&name, &told, &inputs) {
                run.give(&order).map_err(|error| error.to_string())?;
            }
            self.told = inputs;
        }
        let over = run.step(ticks).map_err(|error| error.to_string())?;
        Ok(Stepped {
            t_s: match over {
                true => (start_s + run.t_s()).clamp(point_s, point_s + step_s),
                false => point_s + step_s,
            },
            over,
        })
    }

    /// Sets a variable.
    pub fn set(&mut self, number: u32, value: Value) -> Result<(), String> {
        let own = variable(number).ok_or_else(|| format!("variable {number}: there is none"))?;
        let name = own.name;
        match own.causality {
            Causality::Output => return Err(format!("'{name}': is an output, and is not set")),
            Causality::Parameter if self.phase == Phase::Steps || self.run.is_some() => {
                return Err(format!(
                    "'{name}': is a parameter, and is set before the run begins"
                ));
            }
            Causality::Parameter | Causality::Input => {}
        }
        let inputs = &mut self.inputs;
        match (number, value) {
            (reference::SEED, Value::UInt64(seed)) => self.seed = seed,
            (reference::DRIVE, Value::Boolean(drive)) => inputs.drive = drive,
            (reference::FIRE, Value::Boolean(fire)) => inputs.fire = fire,
            (reference::GIMBAL_AZIMUTH, Value::Float64(x)) => inputs.rates_radps[0] = x,
            (reference::GIMBAL_ELEVATION, Value::Float64(x)) => inputs.rates_radps[1] = x,
            (reference::MIRROR_RIGHT, Value::Float64(x)) => inputs.mirror_rad[0] = x,
            (reference::MIRROR_UP, Value::Float64(x)) => inputs.mirror_rad[1] = x,
            _ => return Err(format!("'{name}': is of another type")),
        }
        Ok(())
    }

    /// Gets a variable.
    pub fn get(&mut self, number: u32) -> Result<Value, String> {
        let inputs = &self.inputs;
        let known = match number {
            boresight::fmu::TIME => {
                let t_s = self.run.as_ref().map_or(0.0, Simulation::t_s);
                Some(Value::Float64(self.start_s + t_s))
            }
            reference::SEED => Some(Value::UInt64(self.seed)),
            reference::DRIVE => Some(Value::Boolean(inputs.drive)),
            reference::FIRE => Some(Value::Boolean(inputs.fire)),
            reference::GIMBAL_AZIMUTH => Some(Value::Float64(inputs.rates_radps[0])),
            reference::GIMBAL_ELEVATION => Some(Value::Float64(inputs.rates_radps[1])),
            reference::MIRROR_RIGHT => Some(Value::Float64(inputs.mirror_rad[0])),
            reference::MIRROR_UP => Some(Value::Float64(inputs.mirror_rad[1])),
            _ => None,
        };
        if let Some(value) = known {
            return Ok(value);
        }
        let own = variable(number).ok_or_else(|| format!("variable {number}: there is none"))?;
        if self.phase == Phase::Instantiated {
            return Err(format!(
                "'{}': has no value before initialization",
                own.name
            ));
        }
        let name = self.name.clone();
        let run = self.built()?;
        let view = run.view();
        match number {
            reference::OVER => return Ok(Value::Boolean(run.over())),
            reference::HASH => return Ok(Value::UInt64(view.state_hash())),
            _ => {}
        }
        let station = view
            .station(&name)
            .ok_or_else(|| format!("station '{name}': there is none"))?;
        output(&station, number).ok_or_else(|| format!("'{}': has no value", own.name))
    }
}

/// Ticks of a step, which must be whole.
fn whole_ticks(step_s: f64, tick_hz: f64) -> Result<u64, String> {
    let ticks = step_s * tick_hz;
    let whole = ticks.round();
    match (1.0..1e15).contains(&whole) && (ticks - whole).abs() <= TOLERANCE_TICKS {
        true => Ok(whole as u64),
        false => Err(format!(
            "a communication step of {step_s} s is no whole number of ticks of 1/{tick_hz} s; give a multiple of that"
        )),
    }
}

/// The orders by which the station does what is set now, and not what it was told before.
fn orders(station: &str, told: &Inputs, now: &Inputs) -> Vec<OrderConfig> {
    let order = || OrderConfig {
        station: Some(station.to_owned()),
        ..OrderConfig::default()
    };
    let drive = (told.driven() != now.driven()).then(|| OrderConfig {
        drive: Some(now.driven()),
        ..order()
    });
    let fire = (told.fire != now.fire).then(|| OrderConfig {
        fire: Some(now.fire),
        ..order()
    });
    drive.into_iter().chain(fire).collect()
}

/// An output of a station.
fn output(station: &StationView, number: u32) -> Option<Value> {
    let mount = station.mount();
    let beam = station.beam();
    let target = station.target();
    let error_rad = || {
        let axis = mount.believed_axis_enu;
        let believed = [axis.x.atan2(axis.y), axis.z.clamp(-1.0, 1.0).asin()];
        let wanted = target.as_ref()?.az_el_rad();
        Some([wrap_pi(wanted.x - believed[0]), wanted.y - believed[1]])
    };
    let [az, el] = [0, 1].map(|axis| error_rad().map_or(0.0, |error: [f64; 2]| error[axis]));
    Some(match number {
        reference::HELD => Value::Boolean(target.is_some() && station.state().acquired()),
        reference::ERROR_AZIMUTH => Value::Float64(az),
        reference::ERROR_ELEVATION => Value::Float64(el),
        reference::RANGE => {
            let range = target.as_ref().and_then(|target| target.range_m());
            Value::Float64(range.map_or(0.0, |(range_m, _)| range_m))
        }
        reference::ENCODER_AZIMUTH => Value::Float64(mount.measured_az_el_rad.x),
        reference::ENCODER_ELEVATION => Value::Float64(mount.measured_az_el_rad.y),
        reference::RATE_AZIMUTH => Value::Float64(mount.measured_rates_radps.x),
        reference::RATE_ELEVATION => Value::Float64(mount.measured_rates_radps.y),
        reference::AT_RIGHT => Value::Float64(mount.mirror_rad.x),
        reference::AT_UP => Value::Float64(mount.mirror_rad.y),
        reference::FIRING => Value::Boolean(beam.firing),
        reference::POWER => Value::Float64(beam.power_in_bucket_w),
        reference::ENERGY => Value::Float64(beam.energy_j),
        reference::STATE => Value::Int64(number_of(station.state())),
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_step_is_whole_ticks() {
        assert_eq!(whole_ticks(1.0 / 960.0, 960.0), Ok(1));
        assert_eq!(whole_ticks(0.1, 960.0), Ok(96));
        for step_s in [0.0, -0.1, 0.001, f64::NAN, f64::INFINITY, 1e300] {
            let error = whole_ticks(step_s, 960.0).unwrap_err();
            assert!(error.contains("whole number of ticks"), "{error}");
        }
    }

    #[test]
    fn only_what_changes_is_ordered() {
        let rest = Inputs {
            drive: false,
            rates_radps: [0.0; 2],
            mirror_rad: [0.0; 2],
            fire: true,
        };
        let turned = Inputs {
            rates_radps: [0.1, 0.2],
            ..rest
        };
        // What does not drive is not told.
        assert_eq!(orders("a", &rest, &turned), []);
        let driven = Inputs {
            drive: true,
            ..turned
        };
        let [order] = &orders("a", &turned, &driven)[..] else {
            panic!()
        };
        let rates = order.drive.unwrap().rates_degps.unwrap();
        assert_eq!(rates, [0.1_f64.to_degrees(), 0.2_f64.to_degrees()]);
        assert_eq!(orders("a", &driven, &driven), []);
        let held = Inputs {
            fire: false,
            ..rest
        };
        let [drive, fire] = &orders("a", &driven, &held)[..] else {
            panic!()
        };
        assert_eq!(drive.drive, Some(DriveOrder::default()));
        assert_eq!(fire.fire, Some(false));
    }
}
