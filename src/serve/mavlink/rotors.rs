//! Motors as PX4 numbers them, and rotors as an airframe does.

/// Motors of a quadrotor in X, the one kind that is offered.
pub(super) const MOTORS: usize = 4;

/// The airframe's rotor that each motor is. PX4's motors of a quadrotor in X are front right, rear left, front left, rear
/// right, the first two counter-clockwise; the airframe's rotors go counter-clockwise from the front left, which turns
/// clockwise. Their senses agree.
const ROTOR_OF_MOTOR: [usize; MOTORS] = [3, 1, 0, 2];

/// Throttles of the rotors, 0 to 1, by the controls of the motors; what is no number stands still.
pub(super) fn throttles(controls: &[f32]) -> [f64; MOTORS] {
    let mut throttles = [0.0; MOTORS];
    for (rotor, control) in ROTOR_OF_MOTOR.into_iter().zip(controls) {
        let control = if control.is_nan() {
            0.0
        } else {
            f64::from(*control)
        };
        throttles[rotor] = control.clamp(0.0, 1.0);
    }
    throttles
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::flight::multirotor::Airframe;
    use crate::scenario::catalogue;

    #[test]
    fn motors_stand_and_turn_as_px4_has_them() {
        let airframe = Airframe::new(&catalogue::load("phantom4").unwrap());
        // Forward, left and counter-clockwise of motors 1 to 4.
        let wanted = [
            (1.0, -1.0, 1.0),
            (-1.0, 1.0, 1.0),
            (1.0, 1.0, -1.0),
            (-1.0, -1.0, -1.0),
        ];
        assert_eq!(airframe.rotor_count, MOTORS);
        for (rotor, (forward, left, sense)) in ROTOR_OF_MOTOR.into_iter().zip(wanted) {
            let arm = airframe.rotor_arm_body_m[rotor];
            assert_eq!((arm.x.signum(), arm.y.signum()), (forward, left));
            assert_eq!(airframe.rotor_spin[rotor], sense);
        }
    }

    #[test]
    fn controls_are_throttles_within_their_limits() {
        let controls = [0.1, 0.2, 0.3, 0.4, 9.0];
        let found = throttles(&controls).map(|x| x as f32);
        assert_eq!(found, [0.3, 0.2, 0.4, 0.1]);
        assert_eq!(throttles(&[-1.0, 2.0, f32::NAN, 0.5]), [0.0, 1.0, 0.5, 0.0]);
    }
}
