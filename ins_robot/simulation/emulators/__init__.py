# SPDX-License-Identifier: MIT
"""The far end of each wire."""
