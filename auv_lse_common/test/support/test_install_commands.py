"""Install commands of packages whose module has another name."""

import pytest

from auv_lse_common.support.missing_packages import install_command


@pytest.mark.parametrize(
    ("module", "name"), [("yaml", "python3-yaml"), ("PIL", "pillow"), ("dateutil", "python-dateutil"), ("rich", "rich")]
)
def test_the_package_is_named_and_not_the_module(module: str, name: str) -> None:
    assert install_command(module).endswith(name)
