# SPDX-License-Identifier: MIT
"""The figures of the paper and its open questions, from runs of this system."""
