# SPDX-License-Identifier: MIT
"""`python -m ins_robot` is `ins-robot`."""

from ins_robot.cli.main import main

if __name__ == "__main__":
    raise SystemExit(main())
