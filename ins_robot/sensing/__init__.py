# SPDX-License-Identifier: MIT
"""From a device to a message: drivers, codecs, and the pure filters behind them."""
