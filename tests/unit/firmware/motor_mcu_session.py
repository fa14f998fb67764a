# SPDX-License-Identifier: MIT
"""A session with the motor microcontroller that runs under CPython and MicroPython alike.

`python motor_mcu_session.py FIRMWARE_DIRECTORY` prints every frame it sent and every duty.
"""

import binascii
import struct
import sys

sys.path.insert(0, sys.argv[1])

import motor_mcu as mcu

FIRST_MS = 0xFFFFFFFF - 700  # time wraps on the way
FIRST_COUNTS = 0x7FFFFFFF - 500  # so do the counts
ORDERS = {
    3: (mcu.HELLO, mcu.HELLO_FORMAT, (mcu.PROTOCOL,)),
    6: (mcu.CONFIG, mcu.CONFIG_FORMAT, (200, 4096, 8000, 12000)),
    340: (mcu.REARM, mcu.REARM_FORMAT, (mcu.FAULT_BUMPER,)),
    460: (mcu.REARM, mcu.REARM_FORMAT, (mcu.FAULT_DEAD_MAN,)),
}


def run():
    device = mcu.MotorMcu()
    turned = [0.0, 0.0, 0.0]
    speeds = [0.0, 0.0, 0.0]
    duties = (0.0, 0.0, 0.0)
    for step in range(600):
        if step in ORDERS:
            kind, layout, values = ORDERS[step]
            device.receive(mcu.encode_frame(kind, step, struct.pack(layout, *values)))
        if step % 2 == 0 and not 380 <= step < 450:  # a silent host: the dead-man
            order = struct.pack(mcu.SET_POINT_FORMAT, 4000, -9000, 10 * step, 200)
            frame = mcu.encode_frame(mcu.SET_POINT, step, order)
            device.receive(b"\x55\x00\x17" + frame[:9])  # noise, and a frame in two parts
            device.receive(frame[9:])
        for i in range(3):
            speeds[i] += (duties[i] * 12.0 - speeds[i]) * 0.125
            turned[i] += speeds[i] * 0.01
        counts = tuple([mcu.wrap32(FIRST_COUNTS + int(t * 652.0)) for t in turned])
        inputs = mcu.BUMPER if step == 300 else 0
        duties = device.step((FIRST_MS + 10 * step) & 0xFFFFFFFF, counts, inputs, 11900)
        sent = binascii.hexlify(device.transmit()).decode()
        print(step, [int(duty * 1e6) for duty in duties], sent)


run()
