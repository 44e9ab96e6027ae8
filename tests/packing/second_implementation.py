# SPDX-License-Identifier: MIT
"""The packed format a second time, written from `docs/packed-format.md` alone by someone who had not seen the code."""

# ruff: noqa
# mypy: ignore-errors

NAMES = ("identity", "clamped", "relu", "abs", "hat", "step", "tanh", "sigmoid", "sin", "gauss")
CODE = {name: code for code, name in enumerate(NAMES)}
ENCODINGS = ("bytes", "rice", "planes", "two_bits", "trits")


def width(n):
    w = 0
    while (1 << w) < n:
        w += 1
    return w


class _Writer:
    def __init__(self):
        self.bits = []

    def put(self, value, n):
        assert 0 <= value < (1 << n), (value, n)
        self.bits.extend((value >> i) & 1 for i in range(n))

    def signed(self, value, n):
        assert n and -(1 << (n - 1)) <= value < (1 << (n - 1))
        self.put(value & ((1 << n) - 1), n)

    def count(self, value):
        while True:
            self.put(value & 31, 5)
            value >>= 5
            self.put(1 if value else 0, 1)
            if not value:
                return

    def rice(self, value, k):
        self.bits.extend([1] * (value >> k))
        self.bits.append(0)
        self.put(value & ((1 << k) - 1), k)

    def align(self):
        self.bits.extend([0] * (-len(self.bits) % 8))

    def blob(self):
        self.align()
        b = self.bits
        return bytes(sum(b[i + t] << t for t in range(8)) for i in range(0, len(b), 8))


class _Reader:
    def __init__(self, blob):
        self.blob = bytes(blob)
        self.at = 0

    def get(self, n):
        value = 0
        for i in range(n):
            byte = self.at >> 3
            if byte >= len(self.blob):
                raise ValueError("blob too short")
            value |= ((self.blob[byte] >> (self.at & 7)) & 1) << i
            self.at += 1
        return value

    def signed(self, n):
        v = self.get(n)
        return v - (1 << n) if n and v >> (n - 1) else v

    def count(self):
        value = shift = 0
        while True:
            value |= self.get(5) << shift
            shift += 5
            if not self.get(1):
                return value

    def rice(self, k):
        q = 0
        while self.get(1):
            q += 1
        return q << k | self.get(k)

    def align(self):
        if self.get(-self.at % 8):
            raise ValueError("padding is not zero")


def pack(c, encoding):
    """The blob of a canonical controller, given as plain data with all keys."""
    if encoding not in ENCODINGS:
        raise ValueError("unknown encoding %r" % (encoding,))
    f = c["frac_bits"]
    one = 1 << f
    nodes = c["nodes"]
    num_in, num_nodes, num_out = len(c["inputs"]), len(nodes), len(c["outputs"])
    total = num_in + num_nodes
    biases = [n["bias"] for n in nodes]
    if not any(biases):
        mode = 0
    elif all(b in (0, one, -one) for b in biases):
        mode = 1
    else:
        mode = 2
    every = [k for n in nodes for k in n["links"]]
    shifts = any(k["shift"] for k in every)
    if shifts and encoding in ("planes", "two_bits", "trits"):
        raise ValueError(encoding + " has no shifts")
    delayed = sorted({k["source"] for k in every if k["delay"]})
    empty = any(not n["links"] and not (mode == 1 and n["bias"]) for n in nodes)
    # slots
    slot = num_in
    one_slot = slot
    slot += mode == 1
    zero_slot = slot
    slot += empty
    delayed_slot = {s: slot + i for i, s in enumerate(delayed)}
    first_node = slot + len(delayed)
    num_slots = first_node + num_nodes
    rows = []
    for n in nodes:
        row = []
        for k in n["links"]:
            s = k["source"]
            if k["delay"]:
                s = delayed_slot[s]
            elif s >= num_in:
                s = first_node + s - num_in
            row.append((s, k["shift"], 1 if k["sign"] < 0 else 0))
        if mode == 1 and n["bias"]:
            row.append((one_slot, 0, 1 if n["bias"] < 0 else 0))
        rows.append(sorted(row))
    # header
    use_map = num_out > num_nodes or c["outputs"] != [{"signal": total - num_out + i} for i in range(num_out)]
    kinds = [(i["scale"], i["limit"]) for i in c["inputs"]]
    use_classes = any(k != (0, 32767) for k in kinds)
    used = sorted({CODE[n["activation"]] for n in nodes})
    gains = [n["gain"] for n in nodes] or [0]
    low_gain = min(gains)
    gain_bits = width(max(gains) - low_gain + 1)
    w = _Writer()
    w.put(1, 3)
    w.put(ENCODINGS.index(encoding), 3)
    w.put(f - 4, 4)
    w.put(mode, 2)
    w.put(int(shifts), 1)
    w.put(int(bool(delayed)), 1)
    w.put(int(empty), 1)
    w.put(int(use_map), 1)
    w.put(int(use_classes), 1)
    w.count(num_in)
    w.count(num_nodes)
    w.count(num_out)
    if len(used) == 1:
        w.put(0, 1)
        w.put(used[0], 4)
    else:
        w.put(1, 1)
        w.put(sum(1 << a for a in used), 10)
    w.put(low_gain + 7, 4)
    w.put(gain_bits, 3)
    bias_bits = 0
    if mode == 2:
        bias_bits = max((b if b >= 0 else ~b).bit_length() + 1 for b in biases)
        w.put(bias_bits, 6)
    index_bits = width(total)
    if delayed:
        w.count(len(delayed))
        for s in delayed:
            w.put(s, index_bits)
    if use_map:
        for o in c["outputs"]:
            if "constant" in o:
                w.put(1, 1)
                w.signed(o["constant"], 16)
            else:
                w.put(0, 1)
                w.put(o["signal"], index_bits)
    if use_classes:
        classes = sorted(set(kinds))
        w.count(len(classes))
        for scale, limit in classes:
            w.put(scale + 16, 5)
            w.put(limit, 15)
        for k in kinds:
            w.put(classes.index(k), width(len(classes)))
    w.align()

    # body
    def fields(n):
        w.put(used.index(CODE[n["activation"]]), width(len(used)))
        w.put(n["gain"] - low_gain, gain_bits)
        if mode == 2:
            w.signed(n["bias"], bias_bits)

    if encoding == "bytes":
        size = -(-(width(num_slots) + 3 * shifts + 2) // 8)
        top = 8 * size
        for n, row in zip(nodes, rows):
            fields(n)
            w.align()
            row = row or [(zero_slot, 0, 0)]
            for i, (s, shift, minus) in enumerate(row):
                record = s | minus << (top - 2) | (i == len(row) - 1) << (top - 1)
                if shifts:
                    record |= shift << (top - 5)
                w.put(record, top)
    elif encoding == "rice":
        gaps = []
        for row in rows:
            at, g = 0, []
            for s, _, _ in row:
                g.append(s - at)
                at = s if shifts else s + 1
            gaps.append(g)

        def best(values):
            return min(range(8), key=lambda k: (sum((v >> k) + 1 + k for v in values), k))

        pn = best([len(row) for row in rows])
        pg = best([v for g in gaps for v in g])
        w.put(pn, 3)
        w.put(pg, 3)
        for n, row, g in zip(nodes, rows, gaps):
            fields(n)
            w.rice(len(row), pn)
            for (_, shift, minus), gap in zip(row, g):
                w.rice(gap, pg)
                if shifts:
                    w.put(shift, 3)
                w.put(minus, 1)
    else:
        dense = []
        for j, row in enumerate(rows):
            line = [0] * (first_node + j)
            for s, _, minus in row:
                line[s] = 2 if minus else 1
            dense.append(line)
        if encoding == "planes":
            for n, line in zip(nodes, dense):
                fields(n)
                for t in line:
                    w.put(1 if t else 0, 1)
                for t in line:
                    if t:
                        w.put(t - 1, 1)
        elif encoding == "two_bits":
            for n, line in zip(nodes, dense):
                fields(n)
                for t in line:
                    w.put(t, 2)
        else:
            for n in nodes:
                fields(n)
            w.align()
            flat = [t for line in dense for t in line]
            flat += [0] * (-len(flat) % 5)
            for i in range(0, len(flat), 5):
                byte = 0
                for t in flat[i : i + 5]:
                    byte = 3 * byte + t
                w.put(byte, 8)
    return w.blob()


def unpack(blob):
    """The plain data of the controller in a valid blob."""
    r = _Reader(blob)
    if r.get(3) != 1:
        raise ValueError("version")
    encoding = ENCODINGS[r.get(3)]
    f = r.get(4) + 4
    mode = r.get(2)
    shifts, delays, empty, use_map, use_classes = (r.get(1) for _ in range(5))
    num_in, num_nodes, num_out = r.count(), r.count(), r.count()
    total = num_in + num_nodes
    if r.get(1):
        mask = r.get(10)
        used = [a for a in range(10) if mask >> a & 1]
    else:
        used = [r.get(4)]
    low_gain = r.get(4) - 7
    gain_bits = r.get(3)
    bias_bits = r.get(6) if mode == 2 else 0
    index_bits = width(total)
    delayed = [r.get(index_bits) for _ in range(r.count())] if delays else []
    if use_map:
        outputs = []
        for _ in range(num_out):
            if r.get(1):
                outputs.append({"constant": r.signed(16)})
            else:
                outputs.append({"signal": r.get(index_bits)})
    else:
        outputs = [{"signal": total - num_out + i} for i in range(num_out)]
    if use_classes:
        classes = []
        for _ in range(r.count()):
            scale = r.get(5) - 16
            classes.append((scale, r.get(15)))
        kinds = [classes[r.get(width(len(classes)))] for _ in range(num_in)]
    else:
        kinds = [(0, 32767)] * num_in
    r.align()
    # slots: what each one stands for
    meaning = [(s, 0) for s in range(num_in)]
    if mode == 1:
        meaning.append("one")
    zero_slot = len(meaning)
    if empty:
        meaning.append("zero")
    meaning += [(s, 1) for s in delayed]
    first_node = len(meaning)
    meaning += [(num_in + j, 0) for j in range(num_nodes)]

    def fields():
        activation = NAMES[used[r.get(width(len(used)))]]
        gain = r.get(gain_bits) + low_gain
        bias = r.signed(bias_bits) if mode == 2 else 0
        return {"activation": activation, "gain": gain, "bias": bias, "links": []}

    nodes, rows = [], []  # a row: (slot, shift, minus)
    if encoding == "bytes":
        size = -(-(width(len(meaning)) + 3 * shifts + 2) // 8)
        top = 8 * size
        for _ in range(num_nodes):
            nodes.append(fields())
            r.align()
            row = []
            while True:
                record = r.get(top)
                shift = record >> (top - 5) & 7 if shifts else 0
                s = record & ((1 << (top - (5 if shifts else 2))) - 1)
                if not (empty and s == zero_slot):
                    row.append((s, shift, record >> (top - 2) & 1))
                if record >> (top - 1):
                    break
            rows.append(row)
    elif encoding == "rice":
        pn, pg = r.get(3), r.get(3)
        for _ in range(num_nodes):
            nodes.append(fields())
            row, at = [], 0
            for _ in range(r.rice(pn)):
                s = at + r.rice(pg)
                shift = r.get(3) if shifts else 0
                row.append((s, shift, r.get(1)))
                at = s if shifts else s + 1
            rows.append(row)
    elif encoding == "planes":
        for j in range(num_nodes):
            nodes.append(fields())
            present = [s for s, b in enumerate([r.get(1) for _ in range(first_node + j)]) if b]
            rows.append([(s, 0, r.get(1)) for s in present])
    elif encoding == "two_bits":
        for j in range(num_nodes):
            nodes.append(fields())
            row = []
            for s in range(first_node + j):
                t = r.get(2)
                if t == 3:
                    raise ValueError("weight 3")
                if t:
                    row.append((s, 0, t - 1))
            rows.append(row)
    else:
        nodes = [fields() for _ in range(num_nodes)]
        r.align()
        need = sum(first_node + j for j in range(num_nodes))
        flat = []
        for _ in range(-(-need // 5)):
            byte = r.get(8)
            if byte >= 243:
                raise ValueError("not five trits")
            flat += [byte // 81, byte // 27 % 3, byte // 9 % 3, byte // 3 % 3, byte % 3]
        at = 0
        for j in range(num_nodes):
            line = flat[at : at + first_node + j]
            at += first_node + j
            rows.append([(s, 0, t - 1) for s, t in enumerate(line) if t])
    r.align()
    if r.at != 8 * len(r.blob):
        raise ValueError("bytes left over")
    for n, row in zip(nodes, rows):
        for s, shift, minus in row:
            sign = -1 if minus else 1
            what = meaning[s]
            if what == "one":
                n["bias"] = sign << f
            elif what == "zero":
                raise ValueError("a link from the slot of 0")
            else:
                n["links"].append({"source": what[0], "sign": sign, "shift": shift, "delay": what[1]})
        n["links"].sort(key=lambda k: (k["source"], k["delay"], k["shift"]))
    return {
        "frac_bits": f,
        "inputs": [{"scale": s, "limit": m} for s, m in kinds],
        "nodes": nodes,
        "outputs": outputs,
    }
