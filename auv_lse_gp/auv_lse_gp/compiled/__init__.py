"""Inner loops compiled with numba, imported when first used."""

from auv_lse_common.support.compiled import copy_compiled

copy_compiled(__file__)
