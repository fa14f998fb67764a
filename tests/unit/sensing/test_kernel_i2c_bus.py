# SPDX-License-Identifier: MIT
"""/dev/i2c-N: each access is one transaction, and refusals say what to do."""

from __future__ import annotations

import errno
from pathlib import Path

import pytest
import smbus2

from ins_robot.errors import DeviceError
from ins_robot.sensing.drivers.i2c_bus import open_i2c_bus


class RecordingBus:
    """Stands for smbus2.SMBus at its i2c_rdwr call, the last thing before the kernel."""

    def __init__(self, path: str) -> None:
        self.transactions: list[list[tuple[int, int, bytes]]] = []
        RecordingBus.last = self

    def i2c_rdwr(self, *messages: smbus2.i2c_msg) -> None:
        self.transactions.append([(m.addr, m.flags, bytes(m)) for m in messages])
        if len(messages) == 2:
            messages[1].buf.contents.value = 0x68

    def close(self) -> None:
        pass


def test_one_transaction_for_each_access(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smbus2, "SMBus", RecordingBus)
    bus = open_i2c_bus("/dev/i2c-1")
    bus.read(0x68, 0x75, 2)
    bus.write(0x68, 0x6B, b"\x01")
    read_flag = 0x01
    (point, data), (write,) = RecordingBus.last.transactions
    assert point == (0x68, 0, b"\x75")
    assert data[:2] == (0x68, read_flag)
    assert len(data[2]) == 2
    assert write == (0x68, 0, b"\x6b\x01")
    bus.close()


@pytest.mark.parametrize(
    ("code", "advice"), [(errno.ENOENT, "raspi-config"), (errno.EACCES, "group i2c")]
)
def test_refusals_say_what_to_do(
    code: int, advice: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(path: str) -> None:
        raise OSError(code, "refused")

    monkeypatch.setattr(smbus2, "SMBus", refuse)
    with pytest.raises(DeviceError, match=advice):
        open_i2c_bus("/dev/i2c-1")
