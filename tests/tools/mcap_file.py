"""An independent reader of MCAP with ROS 2 messages, written from https://mcap.dev/spec, the ros2msg definitions in the
file itself, and the rules of CDR."""

import ctypes
import re
import struct
import zlib

MAGIC = b"\x89MCAP0\r\n"
zstd = ctypes.CDLL("libzstd.so.1")
for function in (zstd.ZSTD_decompress, zstd.ZSTD_compress, zstd.ZSTD_compressBound):
    function.restype = ctypes.c_size_t


def unpack(data, size):
    out = ctypes.create_string_buffer(size)
    done = zstd.ZSTD_decompress(out, ctypes.c_size_t(size), data, ctypes.c_size_t(len(data)))
    assert done == size, done
    return out.raw


def pack(data):
    out = ctypes.create_string_buffer(len(data) // 100 + 1000 + len(data))
    done = zstd.ZSTD_compress(out, ctypes.c_size_t(len(out)), data, ctypes.c_size_t(len(data)), 3)
    return out.raw[:done]


class Fields:
    def __init__(self, data):
        self.data, self.at = data, 0

    def take(self, code):
        values = struct.unpack_from("<" + code, self.data, self.at)
        self.at += struct.calcsize("<" + code)
        return values[0] if len(values) == 1 else values

    def bytes(self):
        size = self.take("I")
        self.at += size
        assert self.at <= len(self.data)
        return self.data[self.at - size:self.at]

    def text(self):
        return self.bytes().decode()

    def pairs(self, key, value):
        """A map; "s" stands for strings."""
        inside, out = Fields(self.bytes()), {}
        one = lambda code: inside.text() if code == "s" else inside.take(code)
        while inside.at < len(inside.data):
            k = one(key)
            out[k] = one(value)
        return out


def records(data, at, end):
    """(code, fields, offset) of the records there."""
    while at < end:
        code, size = struct.unpack_from("<BQ", data, at)
        yield code, data[at + 9:at + 9 + size], at
        at += 9 + size
    assert at == end


class Cdr:
    """Decodes messages by the definitions in a ros2msg schema."""

    SIZES = {"bool": "B", "byte": "B", "uint8": "B", "int32": "i", "uint32": "I", "uint64": "Q", "float64": "d"}

    def __init__(self, name, text):
        parts = re.split(r"={80}\nMSG: (\S+)\n", text)
        self.types = {name.replace("/msg/", "/"): parts[0]}
        self.types.update(zip(parts[1::2], parts[2::2]))
        self.top = name.replace("/msg/", "/")

    def read(self, data):
        assert data[:4] == b"\0\1\0\0"
        self.data, self.at = data[4:], 0
        value = self.message(self.top)
        assert self.at == len(self.data), "bytes left over"
        return value

    def number(self, code):
        size = struct.calcsize(code)
        self.at += -self.at % size
        self.at += size
        return struct.unpack_from("<" + code, self.data, self.at - size)[0]

    def one(self, kind, package):
        if kind in self.SIZES:
            return self.number(self.SIZES[kind])
        if kind == "string":
            size = self.number("I")
            self.at += size
            assert self.data[self.at - 1] == 0
            return self.data[self.at - size:self.at - 1].decode()
        return self.message(kind if "/" in kind else package + "/" + kind)

    def message(self, kind):
        out = {}
        for line in self.types[kind].splitlines():
            line = line.split("#")[0].strip()
            if not line or "=" in line:
                continue
            field, name = line.split()
            base, _, length = field.partition("[")
            if not length:
                out[name] = self.one(base, kind.split("/")[0])
                continue
            count = self.number("I") if length == "]" else int(length[:-1])
            if base == "uint8":
                self.at += count
                out[name] = self.data[self.at - count:self.at]
            else:
                out[name] = [self.one(base, kind.split("/")[0]) for _ in range(count)]
        return out


class File:
    """A whole file, read by its index; checks everything that the specification lets a reader rely on."""

    def __init__(self, name):
        with open(name, "rb") as f:
            self.data = data = f.read()
        assert data[:8] == MAGIC and data[-8:] == MAGIC
        code, size, start, offsets, crc = struct.unpack("<BQQQI", data[-37:-8])
        assert (code, size) == (2, 20)
        assert zlib.crc32(data[start:-12]) == crc
        self.schemas, self.channels, self.metadata, self.messages = {}, {}, {}, []
        self.indexes, groups, self.statistics = [], {}, None
        for code, fields, at in records(data, start, offsets):
            groups.setdefault(code, [at, at])[1] = at + 9 + len(fields)
            self.summary_record(code, Fields(fields))
        for code, fields, _ in records(data, offsets, len(data) - 37):
            assert code == 14
            group, begin, length = struct.unpack("<BQQ", fields)
            assert groups.pop(group) == [begin, begin + length]
        assert not groups, "a group without its offset"
        self.walk(start)
        for index in self.indexes:
            self.read_chunk(index)
        assert self.statistics["messages"] == len(self.messages)
        assert self.statistics["chunks"] == len(self.indexes)
        assert self.statistics["counts"] == {c: sum(m[0] == c for m in self.messages) for c in self.channels}
        assert self.statistics["times"] == (min(m[2] for m in self.messages), max(m[2] for m in self.messages))

    def summary_record(self, code, f):
        if code == 3:
            number = f.take("H")
            self.schemas[number] = name, encoding, text = f.text(), f.text(), f.text()
            assert encoding == "ros2msg", (name, text)
        elif code == 4:
            number, schema = f.take("HH")
            self.channels[number] = f.text(), self.schemas[schema]
            assert f.text() == "cdr" and f.pairs("s", "s").keys() == {"offered_qos_profiles"}
        elif code == 8:
            self.indexes.append((f.take("QQQQ"), f.pairs("H", "Q"), f.take("Q"), f.text(), f.take("QQ")))
        elif code == 11:
            messages, schemas, channels, attachments, metadata, chunks, first, last = f.take("QHIIIIQQ")
            assert (schemas, channels, attachments) == (len(self.schemas), len(self.channels), 0)
            self.statistics = {"messages": messages, "chunks": chunks, "times": (first, last),
                               "metadata": metadata, "counts": f.pairs("H", "Q")}
        elif code == 13:
            at, _ = f.take("QQ")
            f_code, size = struct.unpack_from("<BQ", self.data, at)
            inside = Fields(self.data[at + 9:at + 9 + size])
            assert f_code == 12 and inside.text() == f.text()
            pairs = inside.pairs("s", "s")
            self.metadata[pairs["topic"]] = pairs
        else:
            raise AssertionError(code)

    def walk(self, end):
        seen = []
        for code, fields, at in records(self.data, 8, end):
            seen.append(code)
            if code == 1:
                f = Fields(fields)
                assert f.text() == "ros2" and f.text().startswith("bolo ")
            if code == 15:
                assert struct.unpack("<I", fields)[0] == zlib.crc32(self.data[:at])
        assert seen[0] == 1 and seen[-1] == 15 and seen.count(6) == len(self.indexes)

    def read_chunk(self, index):
        (first, last, at, length), places, index_bytes, compression, (packed, size) = index
        code, inside = struct.unpack_from("<BQ", self.data, at)
        assert code == 6 and inside + 9 == length
        f = Fields(self.data[at + 9:at + length])
        assert f.take("QQQ") == (first, last, size)
        crc, name, bytes_ = f.take("I"), f.text(), f.take("Q")
        assert (name, compression, bytes_) == ("zstd", "zstd", packed)
        chunk = unpack(f.data[f.at:], size)
        assert zlib.crc32(chunk) == crc
        found = {}
        for code, fields, offset in records(chunk, 0, len(chunk)):
            assert code == 5
            channel, sequence, log, publish = struct.unpack_from("<HIQQ", fields)
            assert log == publish and first <= log <= last
            found.setdefault(channel, []).append((log, offset))
            self.messages.append((channel, sequence, log, fields[22:]))
        assert places.keys() == found.keys()
        for channel, place in places.items():
            assert at + length <= place < at + length + index_bytes
            code, _ = struct.unpack_from("<BQ", self.data, place)
            f = Fields(self.data[place + 9:])
            assert code == 7 and f.take("H") == channel
            entries = f.bytes()
            assert [struct.unpack_from("<QQ", entries, i) for i in range(0, len(entries), 16)] == found[channel]

    def topic(self, topic):
        """[(sequence, log time, message)]"""
        out = []
        for channel, sequence, log, data in self.messages:
            name, (kind, _, text) = self.channels[channel]
            if name == topic:
                out.append((sequence, log, Cdr(kind, text).read(data)))
        return out
