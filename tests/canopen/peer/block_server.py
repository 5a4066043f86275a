# SPDX-License-Identifier: Apache-2.0
"""Block transfers for python-canopen's SDO server, which has none (CiA 301, 7.2.4.3.9 and on).

`lose` names a segment of the next block that gets lost once, `break_crc` spoils the next CRC.
"""

import binascii
import struct

from canopen.sdo.exceptions import SdoAbortedError
from canopen.sdo.server import SdoServer

SEGMENT = 7


class BlockSdoServer(SdoServer):
    block_size = 127

    def __init__(self, rx_cobid, tx_cobid, node):
        super().__init__(rx_cobid, tx_cobid, node)
        self.state = None
        self.lose = None
        self.break_crc = False
        self.blocks = 0

    def on_request(self, can_id, data, timestamp):
        if self.state == "receiving" and data[0] != 0x80:
            self.on_segment(bytes(data))
        else:
            super().on_request(can_id, data, timestamp)

    def request_aborted(self, data):
        self.state = None
        super().request_aborted(data)

    def answer(self, layout, *values):
        self.send_response(struct.pack(layout, *values).ljust(8, b"\0"))

    def refuse(self, code):
        self.state = None
        self._index, self._subindex = self.object
        raise SdoAbortedError(code)

    def begin(self, data):
        self.object = struct.unpack_from("<HB", data, 1)
        self._index, self._subindex = self.object
        self.with_crc = bool(data[0] & 4)

    # --- the client writes

    def block_download(self, data):
        if not data[0] & 1:
            self.begin(data)
            if not self._node._find_object(*self.object).writable:
                self.refuse(0x06010002)
            self.size = struct.unpack_from("<L", data, 4)[0] if data[0] & 2 else None
            self.received, self.good, self.complete = bytearray(), 0, False
            self.state = "receiving"
            self.answer("<BHBB", 0xA4, *self.object, self.block_size)
            return
        if self.state != "received":
            self.refuse(0x05040001)
        unused = data[0] >> 2 & 7
        content = bytes(self.received[: len(self.received) - unused])
        if self.with_crc and binascii.crc_hqx(content, 0) != struct.unpack_from("<H", data, 1)[0]:
            self.refuse(0x05040004)
        if self.size is not None and self.size != len(content):
            self.refuse(0x06070010)
        self.state = None
        self._index, self._subindex = self.object
        self._node.set_data(*self.object, content, check_writable=True)
        self.blocks += 1
        self.answer("<B", 0xA1)

    def on_segment(self, data):
        sequence, last = data[0] & 0x7F, bool(data[0] & 0x80)
        if sequence == self.lose:
            self.lose = None
            return
        if sequence == self.good + 1:
            self.good = sequence
            self.received += data[1:]
            self.complete = last
        if last or sequence == self.block_size:
            self.answer("<BBB", 0xA2, self.good, self.block_size)
            self.state = "received" if self.complete else "receiving"
            self.good = 0

    # --- the client reads

    def block_upload(self, data):
        match data[0] & 3:
            case 0:
                self.begin(data)
                self.content = self._node.get_data(*self.object, check_readable=True)
                self.window, self.at = data[4], 0
                if not 1 <= self.window <= 127:
                    self.refuse(0x05040002)
                self.state = "begun"
                self.answer("<BHBL", 0xC6, *self.object, len(self.content))
            case 3 if self.state == "begun":
                self.state = "sending"
                self.send_block()
            case 2 if self.state == "sending":
                self.at += SEGMENT * data[1]
                self.window = data[2]
                if self.at < len(self.content):
                    self.send_block()
                    return
                unused = -len(self.content) % SEGMENT
                crc = binascii.crc_hqx(bytes(self.content), 0) if self.with_crc else 0
                if self.break_crc:
                    self.break_crc = False
                    crc ^= 0x5555
                self.state = "sent"
                self.answer("<BH", 0xC1 | unused << 2, crc)
            case 1:
                self.state = None
                self.blocks += 1
            case _:
                self.refuse(0x05040001)

    def send_block(self):
        for sequence in range(1, self.window + 1):
            begin = self.at + SEGMENT * (sequence - 1)
            segment = bytes(self.content[begin : begin + SEGMENT])
            last = begin + SEGMENT >= len(self.content)
            if sequence == self.lose:
                self.lose = None
            else:
                self.send_response(bytes([sequence | (0x80 if last else 0)]) + segment.ljust(SEGMENT, b"\0"))
            if last:
                return
