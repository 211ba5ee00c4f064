"""Inner loops compiled with numba, imported when first used."""
