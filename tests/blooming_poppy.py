"""Peak that thermal blooming leaves of a focused beam, by poppy's split steps: what `boresight validate` holds `wave` to.

    pip install poppy==1.1.2
    python tests/blooming_poppy.py

1.064 µm, W0 5 cm, focused at 1 km; absorption 0.01 /km, wind 4 m/s across, 288.15 K, 1,013.25 hPa, no turbulence.
"""

import warnings

import astropy.units as u
import numpy as np
from poppy import fresnel, optics, physical_wavefront, wfe

warnings.simplefilter("ignore")

GAS_JPKGK, TEMPERATURE_K, PRESSURE_PA, CP_JPKGK = 287.053, 288.15, 101_325.0, 1007.0
RANGE_M, WIND_MPS, ABSORPTION_PM, REFRACTIVITY = 1000.0, 4.0, 1e-5, 2.74e-4


def summed(self, wave):
    """`rho_isobaric` for a wind along x, as a running sum instead of a loop."""
    light = np.asarray(wave.intensity)
    upwind = np.cumsum(light, axis=0) - light
    return -(self.gamma - 1.0) * self.abs_coeff * wave.dx / self.cs2 / abs(self.v0x) * upwind


wfe.ThermalBloomingWFE.rho_isobaric = summed


def peak_wpm2(power_w, steps, heats, side_px=512, half_m=0.4):
    """Greatest irradiance in the focus after so many steps."""
    wave = physical_wavefront.PhysicalFresnelWavefront(
        beam_radius=half_m * u.m, units=u.m, wavelength=1.064e-6 * u.m, npix=side_px, oversample=2, n0=1 + REFRACTIVITY
    )
    wave *= optics.GaussianAperture(w=0.05 * u.m)
    wave.scale_power(power_w)
    wave *= fresnel.QuadraticLens(RANGE_M * u.m)
    step_m = RANGE_M / steps
    air = wfe.ThermalBloomingWFE(
        ABSORPTION_PM / u.m,
        step_m * u.m,
        v0x=WIND_MPS * u.m / u.s,
        cp=CP_JPKGK * u.J / u.kg / u.K,
        cV=(CP_JPKGK - GAS_JPKGK) * u.J / u.kg / u.K,
        rho0=PRESSURE_PA / (GAS_JPKGK * TEMPERATURE_K) * u.kg / u.m**3,
        p0=PRESSURE_PA * u.Pa,
        T0=TEMPERATURE_K * u.K,
        isobaric=True,
        direction="x",
    )
    for way_m in [step_m / 2] + [step_m] * (steps - 1):
        wave.propagate_fresnel(way_m * u.m)
        if heats:
            wave *= air
    wave.propagate_fresnel(step_m / 2 * u.m)
    return float(np.asarray(wave.intensity).max())


if __name__ == "__main__":
    for power_w in (3000.0, 12_000.0):
        for steps in (24, 48):
            left = peak_wpm2(power_w, steps, True) / peak_wpm2(power_w, steps, False)
            print(f"{power_w / 1e3:.0f} kW, {steps} steps: {left:.3f}")
