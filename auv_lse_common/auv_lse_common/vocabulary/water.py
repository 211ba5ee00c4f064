"""Depth of water above a pressure sensor, and the pressure at a depth.

The water column is hydrostatic with one density at the surface, one gravity by latitude, and a constant bulk modulus:

    rho(p) = rho0 exp(p / K),   dp = rho(p) g dz   =>   z = K / (rho0 g) (1 - exp(-p / K))

Compression matters little: 5 cm at 150 m. The increase of gravity with depth (0.5 mm at 100 m) is left out, and so are
layers of different density.
"""

import math

#: Bulk modulus of water (Pa): 2.16e9 for sea water of 0 deg C to 2.3e9 for sea water of 20 deg C.
BULK_MODULUS_PA = 2.2e9
#: Latitude (deg) of a mission without an origin: gravity is then right within 0.27 %.
MEAN_LATITUDE_DEG = 45.0
#: Highest pressure of air on earth (Pa).
HIGHEST_AIR_PA = 108_500.0


def gravity_mps2(latitude_deg: float) -> float:
    """Normal gravity (m/s2) on the WGS84 ellipsoid at a latitude (deg): Somigliana's formula."""
    s = math.sin(math.radians(latitude_deg)) ** 2
    return 9.7803253359 * (1.0 + 0.00193185265241 * s) / math.sqrt(1.0 - 0.00669437999013 * s)


def depth_of(gauge_pa: float, density_kgpm3: float, latitude_deg: float = MEAN_LATITUDE_DEG) -> float:
    """Depth (m, positive down) at a pressure above that at the surface (Pa).

    Args:
        gauge_pa: Absolute pressure minus the pressure at the surface; negative: above the surface.
        density_kgpm3: Density of the water at the surface (kg/m3).
        latitude_deg: Latitude (deg), for gravity.
    """
    metres_per_pa = 1.0 / (density_kgpm3 * gravity_mps2(latitude_deg))
    return -BULK_MODULUS_PA * metres_per_pa * math.expm1(-gauge_pa / BULK_MODULUS_PA)


def gauge_pressure_pa(depth_m: float, density_kgpm3: float, latitude_deg: float = MEAN_LATITUDE_DEG) -> float:
    """Pressure above that at the surface (Pa) at a depth (m); the inverse of `depth_of`."""
    weight_pa = density_kgpm3 * gravity_mps2(latitude_deg) * depth_m
    return -BULK_MODULUS_PA * math.log1p(-weight_pa / BULK_MODULUS_PA)
