# SPDX-License-Identifier: MIT
"""One driver per device and one codec per wire."""
