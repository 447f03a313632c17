#!/usr/bin/env python3
"""Prints the table of docs/reliability.md, section "Bombs": small inputs that claim or ask for
much, the processor's time and the memory that tools take for them, and what they say.

  tests/bombs.py [folder of the tools]

Exits with 1 where a run takes more than a minute, or ends by a signal that was not sent.
"""

import json
import math
import os
import pathlib
import random
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
import zlib

PATIENCE = 60  # Seconds.
ROUNDS = 3  # Runs of each command, of which the shortest counts.


def apart(make, *arguments):
    """Calls make() in a process of its own: what runs later would count this one's memory."""
    child = os.fork()
    if child == 0:
        make(*arguments)
        os._exit(0)
    os.waitpid(child, 0)


def gltf_of_siblings(path, count, buffer="corners.bin"):
    """A root node with `count` children, each of which shows one triangle."""
    path.with_name("corners.bin").write_bytes(struct.pack("<9f", 0, 0, 0, 1, 0, 0, 0, 1, 0))
    children = [{"mesh": 0, "translation": [i, 0, 0]} for i in range(count)]
    tree = {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"children": list(range(1, count + 1))}, *children],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0}}]}],
        "accessors": [
            {
                "bufferView": 0,
                "componentType": 5126,
                "count": 3,
                "type": "VEC3",
                "min": [0, 0, 0],
                "max": [1, 1, 0],
            }
        ],
        "bufferViews": [{"buffer": 0, "byteLength": 36}],
        "buffers": [{"uri": buffer, "byteLength": 36}],
    }
    path.write_text(json.dumps(tree))


def ply_of(path, points, faces):
    head = (
        f"ply\nformat binary_little_endian 1.0\nelement vertex {len(points)}\nproperty float x\n"
        f"property float y\nproperty float z\nelement face {len(faces)}\n"
        "property list int int vertex_indices\nend_header\n"
    )
    body = b"".join(struct.pack("<3f", *p) for p in points)
    body += b"".join(struct.pack(f"<{len(f) + 1}i", len(f), *f) for f in faces)
    path.write_bytes(head.encode() + body)


def comb(path, height):
    """One polygon whose upper side goes up and down 40,000 times."""
    count = 40000
    points = [(i, height * (i % 2), 0) for i in range(count)]
    points += [(count - 1, -1, 0), (0, -1, 0)]
    lines = [f"v {x} {y} {z}" for x, y, z in points]
    lines.append("f " + " ".join(str(i + 1) for i in range(len(points))))
    path.write_text("\n".join(lines) + "\n")


def fan(path, count=100000):
    ring = [(math.cos(6.28 * i / count), math.sin(6.28 * i / count), 0) for i in range(count)]
    ply_of(path, [(0, 0, 0.1), *ring], [(0, i + 1, (i + 1) % count + 1) for i in range(count)])


def soup(path, count=100000):
    """Triangles of length 1 and of width 1e-4 at random places and in random directions."""
    chance = random.Random(1)
    points = []
    for _ in range(count):
        at = [chance.random() for _ in range(3)]
        along = [chance.gauss(0, 0.5) for _ in range(3)]
        points += [at, [a + d for a, d in zip(at, along)], [a + 1e-4 for a in at]]
    ply_of(path, points, [(3 * i, 3 * i + 1, 3 * i + 2) for i in range(count)])


def one_place(path, count=100000):
    """The same triangle many times, each with corners of its own."""
    corners = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    ply_of(path, corners * count, [(3 * i, 3 * i + 1, 3 * i + 2) for i in range(count)])


def far(path, value):
    path.write_text(f"v 0 0 0\nv {value} 0 0\nv 0 1 0\nf 1 2 3\n")


def gif(side):
    head = b"GIF89a" + struct.pack("<HH", side, side) + b"\x80\0\0\0\0\0\xff\xff\xff"
    return head + b"," + struct.pack("<HHHH", 0, 0, side, side) + b"\0\2\2L\1\0;"


def tiff(side):
    """R G B of 8 bits in one strip, compressed by deflate."""
    strip = zlib.compress(bytes(60))
    entries = [(256, 4, 1, side), (257, 4, 1, side), (258, 3, 1, 8), (259, 3, 1, 8), (262, 3, 1, 2)]
    entries += [(273, 4, 1, 122), (277, 3, 1, 3), (278, 4, 1, side), (279, 4, 1, len(strip))]
    tags = b"".join(struct.pack("<HHII", *entry) for entry in entries)
    return b"II*\0\x08\0\0\0" + struct.pack("<H", len(entries)) + tags + bytes(4) + strip


def png(side):
    def chunk(kind, data):
        checksum = struct.pack(">I", zlib.crc32(kind + data))
        return struct.pack(">I", len(data)) + kind + data + checksum

    head = struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0)
    body = chunk(b"IDAT", zlib.compress(bytes(100)))
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + body + chunk(b"IEND", b"")


def jpeg(side):
    """A progressive one, whose first scan is cut off."""
    frame = struct.pack(">HBHHB", 17, 8, side, side, 3) + bytes((1, 17, 0, 2, 17, 0, 3, 17, 0))
    table = b"\xff\xdb" + struct.pack(">HB", 67, 0) + b"\1" * 64
    scan = b"\xff\xda" + struct.pack(">HB", 12, 3) + bytes((1, 0, 2, 0, 3, 0, 0, 0, 0))
    return b"\xff\xd8" + table + b"\xff\xc2" + frame + scan + bytes(8)


def jpeg2000(side):
    size = struct.pack(">HHIIIIIIIIH", 47, 0, side, side, 0, 0, side, side, 0, 0, 3)
    return b"\xff\x4f\xff\x51" + size + b"\7\1\1" * 3 + b"\xff\x93" + bytes(20)


def heif(side):
    extents = struct.pack(">I4sIII", 20, b"ispe", 0, side, side)
    return struct.pack(">I", 24) + b"ftypheic" + bytes(4) + b"mif1heic" + extents


def zeros(megabytes):
    """Zeros, compressed by gzip."""
    packer = zlib.compressobj(9, zlib.DEFLATED, 31)
    block = bytes(1 << 20)
    return b"".join(packer.compress(block) for _ in range(megabytes)) + packer.flush()


def nrrd(path, side, megabytes):
    sizes = f"dimension: 3\nsizes: {side} {side} {side}"
    head = f"NRRD0004\ntype: uchar\n{sizes}\nencoding: gzip\n\n"
    path.write_bytes(head.encode() + zeros(megabytes))


class Bench:
    def __init__(self, tools, work):
        self.tools, self.work = tools, work
        self.good = True

    def file(self, name, content=None):
        path = self.work / name
        if content is not None:
            path.write_bytes(content if isinstance(content, bytes) else content.encode())
        return path

    def start(self, *words):
        command = [str(self.tools / words[0]), *map(str, words[1:]), "--quiet"]
        return subprocess.Popen(
            command,
            cwd=self.work,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def wait(self, process):
        """Processor's time in seconds, MB, the exit code and the last message of a run."""
        timer = threading.Timer(PATIENCE, process.kill)
        timer.start()
        said = process.stderr.read() + process.stdout.read()
        _, status, usage = os.wait4(process.pid, 0)
        timer.cancel()
        process.returncode = os.waitstatus_to_exitcode(status)
        lines = [line for line in said.splitlines() if line.strip()]
        said = (lines or [""])[-1].replace(str(self.work) + "/", "")
        seconds = usage.ru_utime + usage.ru_stime
        return seconds, usage.ru_maxrss / 1024, process.returncode, said

    def row(self, what, size, words, found):
        seconds, memory, code, said = found
        self.good = self.good and code >= 0
        told = re.sub(r"^surfel-[a-z-]+: (error: )?", "", said).replace("|", "\\|")
        ends = {0: "done", 1: "refused", 2: "refused"}.get(code, f"signal {-code}")
        command = " ".join(map(str, words)).replace(str(self.work) + "/", "")
        size = "" if not size else f"{size} bytes" if size < 10000 else f"{size / 1e6:.2f} MB"
        print(f"| {what} | {size} | `{command}` | {seconds:.2f} s | {memory:.0f} MB | ", end="")
        print(f"{ends}{': ' + told if code and told else ''} |", flush=True)

    def run(self, what, bomb, *words):
        found = min(self.wait(self.start(*words)) for _ in range(ROUNDS))
        self.row(what, bomb.stat().st_size, words, found)


def meshes(bench):
    for count in (40000, 200000):
        path = bench.file(f"siblings_{count}.gltf")
        apart(gltf_of_siblings, path, count)
        bench.run(f"glTF of {count} siblings", path, "surfel-info", path.name)
    sampled = ("--count", "1000", "-o", "o.ply")
    for height in (500, 1000, 40000):
        path = bench.file(f"comb_{height}.obj")
        apart(comb, path, height)
        bench.run(f"comb of height {height}", path, "surfel-from-mesh", path.name, *sampled)
    for make, what in ((fan, "fan of 100,000 faces"), (soup, "soup of 100,000 long triangles")):
        path = bench.file(f"{make.__name__}.ply")
        apart(make, path)
        bench.run(what, path, "surfel-from-mesh", path.name, *sampled)
        bench.run(what, path, "surfel-info", path.name)
    path = bench.file("one_place.ply")
    apart(one_place, path)
    bench.run("100,000 faces in one place", path, "surfel-from-mesh", path.name, *sampled)
    bench.run("100,000 faces in one place", path, "surfel-info", path.name)
    for value in ("1e20", "1e38"):
        path = bench.file(f"far_{value}.obj")
        far(path, value)
        picture = ("--mesh", path.name, "--size", "32x32", "-o", "o.png")
        bench.run(f"a coordinate of {value}", path, "surfel-render", *picture)


def pictures(bench):
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
    bench.file("square.obj", corners + "f 1/1 2/2 3/3 4/4\n")
    bench.start("surfel-from-mesh", "square.obj", "--count", "500", "-o", "s.ply").communicate()
    images = [("gif", gif, 65535), ("tif", tiff, 40000), ("png", png, 65535), ("jpg", jpeg, 65535)]
    for ending, make, side in [*images, ("j2k", jpeg2000, 65535), ("heic", heif, 65535)]:
        path = bench.file(f"claim.{ending}", make(side))
        what = f"{ending.upper()} of {side} x {side}"
        options = ("s.ply", "--mesh", "square.obj", "--image", path.name, "-o", "o.ply")
        bench.run(what, path, "surfel-texture", *options)


def packed(bench):
    for side, megabytes in ((64, 1024), (2048, 1)):
        path = bench.file(f"of_{side}.nrrd")
        apart(nrrd, path, side, megabytes)
        what = f"{megabytes} MB by gzip for {side}^3 voxels"
        bench.run(what, path, "surfel-from-volume", path.name, "--density", "1", "-o", "o.ply")
    path = bench.file("more.spz")
    apart(lambda: path.write_bytes(zeros(1024)))
    bench.run("1024 MB by gzip as splats", path, "surfel-info", path.name)


def settings(bench):
    keys = ".".join(["a"] * 100000) + " = 1\n"
    brackets = "a = " + "[" * 100000 + "]" * 100000 + "\n"
    for name, content in (("keys", keys), ("brackets", brackets)):
        path = bench.file(f"{name}.toml", content)
        for option in ("--scene", "--camera", "--config"):
            picture = ("s.ply", option, path.name, "-o", "o.png")
            bench.run(f"TOML, 100,000 {name}", path, "surfel-render", *picture)
    path = bench.file("views.json", "[" * 100000 + "]" * 100000)
    drawn = ("s.ply", "--views", path.name, "-o", "{name}.png")
    bench.run("JSON, 100,000 brackets", path, "surfel-render", *drawn)


def names(bench):
    """Devices and pipes that stand in files where a file should be."""
    os.mkfifo(bench.file("pipe"))
    for named in ("/dev/zero", "pipe"):
        square = bench.file("square.obj").read_text()
        mesh = bench.file("named.obj", "mtllib named.mtl\nusemtl m\n" + square)
        bench.file("named.mtl", f"newmtl m\nmap_Kd {named}\n")
        textured = ("s.ply", "--mesh", mesh.name, "-o", "o.ply")
        bench.run(f"`{named}` in MTL", mesh, "surfel-texture", *textured)
        head = "NRRD0004\ntype: uchar\ndimension: 3\nsizes: 64 64 64\nencoding: raw\n"
        volume = bench.file("named.nhdr", head + f"data file: {named}\n")
        dense = (volume.name, "--density", "1", "-o", "o.ply")
        bench.run(f"`{named}` in NRRD", volume, "surfel-from-volume", *dense)
        scene = bench.file("named.toml", f'[environment]\nimage = "{named}"\n')
        lit = ("s.ply", "--scene", scene.name, "-o", "o.png")
        bench.run(f"`{named}` in a scene", scene, "surfel-render", *lit)
        tree = bench.file("named.gltf")
        gltf_of_siblings(tree, 1, named)
        bench.run(f"`{named}` in glTF", tree, "surfel-info", tree.name)


def films(bench):
    """A film of many pictures that is interrupted after its first one."""
    options = ("--turntable", "100000", "--size", "16x16", "-o", "f_%06d.png")
    words = ("surfel-render", "s.ply", *options)
    begin = time.perf_counter()
    process = bench.start(*words)
    while not list(bench.work.glob("f_*.png")) and time.perf_counter() < begin + PATIENCE:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    sent = time.perf_counter()
    found = bench.wait(process)
    obeyed = time.perf_counter() - sent
    what = f"film of 100,000 pictures, SIGINT after the first one, obeyed in {obeyed:.2f} s"
    bench.row(what, None, words, found)


def requests(bench):
    """A POST without a length, whose body does not end."""
    words = ("surfel-view", "s.ply", "--serve")
    process = bench.start(*words)
    line = ""
    while "http://" not in line:
        line = process.stdout.readline()
    port = int(re.search(r":(\d+)/", line)[1])
    begin = time.perf_counter()
    sent = 0
    answer = b""
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.settimeout(10)
        try:
            head = b"POST / HTTP/1.1\r\nHost: x\r\nTransfer-Encoding: chunked\r\n\r\n"
            connection.sendall(head)
            block = b"100000\r\n" + bytes(1 << 20) + b"\r\n"
            while sent < 1000 and time.perf_counter() < begin + PATIENCE:
                connection.sendall(block)
                sent += 1
        except OSError:
            pass
        try:
            answer = connection.recv(100)
        except OSError:
            pass
    process.send_signal(signal.SIGINT)
    found = bench.wait(process)
    told = answer.decode(errors="replace").split("\r\n")[0] or "closed"
    what = f"POST without a length: {sent} MB taken, `{told}`"
    bench.row(what, None, words, found)


def main():
    root = pathlib.Path(__file__).resolve().parent.parent
    tools = pathlib.Path(sys.argv[1] if len(sys.argv) > 1 else root / "build/release/bin").resolve()
    print("| bomb | size | command | time | memory | what the tool does |")
    print("|---|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as work:
        bench = Bench(tools, pathlib.Path(work))
        for part in (meshes, pictures, packed, settings, names, films, requests):
            part(bench)
    return 0 if bench.good else 1


if __name__ == "__main__":
    sys.exit(main())
