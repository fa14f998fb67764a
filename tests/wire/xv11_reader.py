# SPDX-License-Identifier: MIT
"""A reader of XV-11 bytes written from the public packet description alone.

Shares nothing with ins_robot, on purpose: it stands for any other program at the terminal.
Description: github.com/Xevel/NXV11/wiki (22 bytes: FA, index A0-F9, speed in 1/64 rpm, four
readings of four bytes, checksum).
"""


def packet_checksum(packet):
    value = 0
    for position in range(0, 20, 2):
        value = value * 2 + packet[position] + packet[position + 1] * 256
    value = value % 32768 + value // 32768
    return value % 32768


class Reader:
    """Byte after byte; a finished turn is a dict from degree to (millimetres, strength)."""

    def __init__(self):
        self.window = []
        self.turn = {}
        self.turns = []
        self.speeds = []
        self.good = 0
        self.last_index = -1

    def push(self, data):
        for byte in data:
            self.window.append(byte)
            if len(self.window) > 22:
                self.window.pop(0)
            if len(self.window) == 22 and self.is_packet(self.window):
                self.take(self.window)
                self.window = []

    @staticmethod
    def is_packet(packet):
        if packet[0] != 250 or not 160 <= packet[1] <= 249:
            return False
        return packet_checksum(packet) == packet[20] + 256 * packet[21]

    def take(self, packet):
        self.good += 1
        index = packet[1] - 160
        if index <= self.last_index:
            self.turns.append(self.turn)
            self.turn = {}
        self.last_index = index
        self.speeds.append((packet[2] + 256 * packet[3]) / 64)
        for number in range(4):
            low, high, power_low, power_high = packet[4 + 4 * number : 8 + 4 * number]
            if high & 128:
                continue  # invalid: the low byte is an error code
            millimetres = low + 256 * (high & 63)
            self.turn[4 * index + number] = (millimetres, power_low + 256 * power_high)
