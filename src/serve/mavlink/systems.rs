//! How UAVs and stations are numbered.

/// UAVs are the systems from 1 on, stations those from here on.
pub(super) const FIRST_STATION: u8 = 250;
/// Ground stations call themselves 255.
pub(super) const MOST_STATIONS: usize = 5;
/// Numbers below the stations'.
pub(super) const MOST_UAVS: usize = FIRST_STATION as usize - 1;

/// The system that a UAV is, by its number in the scenario.
pub(super) fn of_uav(index: usize) -> u8 {
    u8::try_from(index + 1).unwrap_or(u8::MAX)
}

/// The system that a station is, by its number in the scenario.
pub(super) fn of_station(index: usize) -> u8 {
    FIRST_STATION.saturating_add(u8::try_from(index).unwrap_or(u8::MAX))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_two_have_one_number() {
        assert_eq!((of_uav(0), of_uav(MOST_UAVS - 1)), (1, 249));
        assert_eq!((of_station(0), of_station(MOST_STATIONS - 1)), (250, 254));
    }
}
