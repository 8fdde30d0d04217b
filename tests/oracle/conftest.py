"""What a failing assertion compares is shown there too, where no test stands."""

from __future__ import annotations

import pytest

pytest.register_assert_rewrite("tests.oracle.histories")
