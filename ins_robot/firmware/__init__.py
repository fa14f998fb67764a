# SPDX-License-Identifier: MIT
"""Code that also runs on the motor microcontroller: no numpy, asyncio or hardware."""
