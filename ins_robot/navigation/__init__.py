# SPDX-License-Identifier: MIT
"""The paper's INS: gaps, nodes, neighbours, the way to the next scan."""
