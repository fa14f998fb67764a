# SPDX-License-Identifier: MIT
"""What every test may rely on."""

import signal


def pytest_configure() -> None:
    """Ctrl-C works: a shell starts what runs in its background with it ignored."""
    signal.signal(signal.SIGINT, signal.default_int_handler)
