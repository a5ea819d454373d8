"""What a recogniser is given and gives, as `boresight` checks it (models/tracking/recognition.rs)."""

STEPS, CHIP = 16, 24
CHIP_OVER_BOX, LEAST_CHIP_PX = 2.0, 16.0  # a chip's side over the box's, and its least in the camera's pixels
CLASSES = ("uav", "bird", "aeroplane", "helicopter", "balloon", "other")
FEATURES = (
    "age_s", "sky_known", "right_sizes", "up_sizes", "rate_right", "rate_up", "rate_sizes", "position_flutter",
    "log_size_mrad", "log_size_px", "log_size_change", "log_aspect", "log_aspect_change", "size_flutter", "score",
    "seen_share", "named_uav", "named_bird", "named_aeroplane", "named_helicopter", "named_balloon", "named_other",
)  # fmt: skip
