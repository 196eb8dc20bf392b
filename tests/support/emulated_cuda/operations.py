"""PTX instructions as C++ statements, a function for each family (PTX ISA, NVIDIA, chapter 9)."""

from __future__ import annotations

from collections.abc import Callable

from support.emulated_cuda.operands import Operands, members, name_of, unsigned
from support.emulated_cuda.ptx import Instruction, NotTranslated, bits_of

SPACES = ("global", "local", "shared", "param", "const")

# Caches, orders and scopes of memory, and hints: none changes what a single thread computes.
_HINTS = {"volatile", "relaxed", "acquire", "release", "acq_rel", "weak", "gpu", "sys", "cta", "nc", "uni"}
_CACHES = ("L1::", "L2::", "ca", "cg", "cs", "cv", "lu", "wb", "wt")
_WHOLE = {"rni": "to_nearest", "rzi": "to_zero", "rmi": "to_lower", "rpi": "to_upper"}
_NUMBERS = {f"{sign}{width}" for sign in "us" for width in (8, 16, 32, 64)} | {"f32", "f64"}
_SIGNS = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^", "div": "/"}
_ORDERED = {"eq": "==", "lt": "<", "le": "<=", "gt": ">", "ge": ">=", "lo": "<", "ls": "<=", "hi": ">", "hs": ">="}
_ATOMIC = {
    "add": "old + by",
    "min": "old < by ? old : by",
    "max": "old > by ? old : by",
}
_TOGETHER = {
    "activemask.b32": "ACTIVE_MASK",
    "vote.sync.ballot.b32": "BALLOT",
    "bar.warp.sync": "BARRIER",
}
TOGETHER = frozenset(name.partition(".")[0] for name in _TOGETHER)
"""Instructions that wait for other threads of the warp."""

_APPROXIMATE = {"ex2": "exp2f", "lg2": "log2f", "sin": "sinf", "cos": "cosf"}


def translate(instruction: Instruction, operands: Operands) -> str:
    """Return an instruction as statements of C++.

    Raises:
        NotTranslated: on what the emulator does not know.
    """
    family = _FAMILIES.get(instruction.opcode[0])
    text = None if family is None else family(operands, instruction.opcode, instruction.operands)
    if text is None:
        raise NotTranslated(".".join(instruction.opcode))
    return text


def _only(modifiers: tuple[str, ...], *supported: str) -> bool:
    """Return whether all modifiers are supported, or hints."""
    return all(m in supported or m in _HINTS or m.startswith(_CACHES) for m in modifiers)


def _flushed(value: str, kind: str, modifiers: tuple[str, ...]) -> str:
    """Return a value, flushed to zero if it is subnormal and the instruction says so, which it may for 32 bits."""
    return f"flushed({value})" if "ftz" in modifiers and kind == "f32" else value


def _move(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    kind = opcode[-1]
    if len(opcode) != 2:
        return None
    if ops[0].startswith("{"):
        parts, width = members(ops[0]), bits_of(kind) // len(members(ops[0]))
        assigned = [o.assign(part, f"all >> {i * width}", f"b{width}") for i, part in enumerate(parts)]
        return f"const u64 all = {o.value(ops[1], 'b' + kind[1:])}; {' '.join(assigned)}"
    if ops[1].startswith("{"):
        parts, width = members(ops[1]), bits_of(kind) // len(members(ops[1]))
        joined = " | ".join(f"(u64){o.value(part, f'b{width}')} << {i * width}" for i, part in enumerate(parts))
        return o.assign(ops[0], joined, "b" + kind[1:])
    kind = kind if kind == "pred" else f"b{bits_of(kind)}"
    return o.assign(ops[0], o.value(ops[1], kind), kind)


def _load(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    space, kind = _space(opcode), opcode[-1]
    if not _only(opcode[1:-1], *SPACES, "v2", "v4", "v8"):
        return None
    size, targets = bits_of(kind) // 8, members(ops[0])
    # All is read before a target is written, which may be part of the address.
    read = [f"const {kind} x{i} = load<{kind}>(place + {i * size});" for i in range(len(targets))]
    written = [o.assign(target, f"x{i}", kind) for i, target in enumerate(targets)]
    return " ".join([f"const u64 place = {o.address(ops[1], space)};", *read, *written])


def _store(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    space, kind = _space(opcode), opcode[-1]
    if not _only(opcode[1:-1], *SPACES, "v2", "v4", "v8"):
        return None
    size = bits_of(kind) // 8
    put = [f"store<{kind}>(place + {i * size}, {o.value(source, kind)});" for i, source in enumerate(members(ops[1]))]
    return " ".join([f"const u64 place = {o.address(ops[0], space)};", *put])


def _space(opcode: tuple[str, ...]) -> str:
    return next((part for part in opcode[1:] if part in SPACES), "")


def _convert_address(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    value = o.value(ops[1], "u64")
    if "shared" in opcode:
        value = f"{value} - (u64)shared" if "to" in opcode else f"{value} + (u64)shared"
    return o.assign(ops[0], value, "u64")


def _atomic(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    what, kind = opcode[-2], opcode[-1]
    if not _only(opcode[1:-2], "global", "shared") or (kind[0] == "f" and what != "add"):
        return None
    target, place, *values = ops
    by = o.value(values[0], kind)
    if what == "cas":
        new = f"old == by ? {o.value(values[1], kind)} : old"
    elif what in _ATOMIC:
        new = _ATOMIC[what]
    else:
        return None
    change = f"[&]({kind} old) {{ const {kind} by = {by}; return ({kind})({new}); }}"
    return o.assign(target, f"atomic<{kind}>({o.address(place, _space(opcode))}, {change})", kind)


def _compare(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    how, kind = opcode[1], opcode[-1]
    if not set(opcode[2:-1]) <= {"ftz"} or "|" in ops[0]:
        return None
    a, b = (_flushed(o.value(op, kind), kind, opcode) for op in ops[1:3])
    ordered = f"({a} == {a} && {b} == {b})"
    if how in ("num", "nan"):
        value = ordered if how == "num" else f"!{ordered}"
    elif kind[0] == "f" and how.endswith("u") and how[:-1] in (*_ORDERED, "ne"):
        value = f"(!{ordered} || {a} {_ORDERED.get(how[:-1], '!=')} {b})"
    elif how == "ne":
        value = f"({ordered} && {a} != {b})" if kind[0] == "f" else f"({a} != {b})"
    elif how in _ORDERED:
        value = f"({a} {_ORDERED[how]} {b})"
    else:
        return None
    return o.assign(ops[0], value, "pred")


def _select(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    kind = f"b{bits_of(opcode[-1])}"
    chosen = f"{o.value(ops[3], 'pred')} ? {o.value(ops[1], kind)} : {o.value(ops[2], kind)}"
    return o.assign(ops[0], chosen, kind) if len(opcode) == 2 else None


def _convert(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    into, source, modifiers = opcode[-2], opcode[-1], opcode[1:-2]
    if not {into, source} <= _NUMBERS or not _only(modifiers, "rn", "ftz", "sat", *_WHOLE):
        return None
    value = _flushed(o.value(ops[1], source), source, modifiers)
    rounding = next((_WHOLE[m] for m in modifiers if m in _WHOLE), None)
    if rounding is not None:
        value = f"{rounding}({value})"
    if "sat" in modifiers:
        if into != "f32":
            return None
        value = f"least(most(({into})({value}), 0.0f), 1.0f)"  # of NaN, 0
    if into[0] == "f":
        return o.assign(ops[0], _flushed(f"({into})({value})", into, modifiers), into)
    if source[0] == "f":
        return None if rounding is None else o.assign(ops[0], f"integer<{into}>({value})", into)
    return o.assign(ops[0], f"({into})({value})", into)


def _arithmetic(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    kind = opcode[-1]
    if kind in ("f32", "f64"):
        return _floating(o, opcode, ops)
    if kind == "pred":
        return _of_predicates(o, opcode, ops)
    return _integer(o, opcode, ops) if kind[0] in "usb" else None


def _of_predicates(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    values = [o.value(op, "pred") for op in ops[1:]]
    if opcode[0] == "not":
        return o.assign(ops[0], f"!{values[0]}", "pred")
    if opcode[0] not in ("and", "or", "xor"):
        return None
    return o.assign(ops[0], f" {_SIGNS[opcode[0]]} ".join(values), "pred")


def _floating(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    name, kind, modifiers = opcode[0], opcode[-1], opcode[1:-1]
    if not _only(modifiers, "rn", "approx", "full", "ftz"):
        return None
    if name in _APPROXIMATE and kind != "f32":
        return None
    values = [_flushed(o.value(op, kind), kind, modifiers) for op in ops[1:]]
    value = _number(name, kind, values)
    return None if value is None else o.assign(ops[0], _flushed(value, kind, modifiers), kind)


def _number(name: str, kind: str, x: list[str]) -> str | None:
    if name in ("add", "sub", "mul", "div"):
        return f"{x[0]} {_SIGNS[name]} {x[1]}"
    if name in ("fma", "mad"):
        return f"multiply_add({x[0]}, {x[1]}, {x[2]})"
    if name in _APPROXIMATE:
        return f"{_APPROXIMATE[name]}({x[0]})"
    simple = {
        "rcp": "({k})1 / {0}",
        "sqrt": "root({0})",
        "rsqrt": "({k})(1 / root((f64){0}))",
        "abs": "magnitude({0})",
        "neg": "-{0}",
        "min": "least({0}, {1})",
        "max": "most({0}, {1})",
        "copysign": "with_sign_of({0}, {1})",
    }
    return simple[name].format(*x, k=kind) if name in simple else None


def _integer(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    name, kind, modifiers = opcode[0], opcode[-1], opcode[1:-1]
    width = bits_of(kind)
    plain = unsigned(width)
    if name in ("mul", "mad"):
        return _product(o, opcode, ops)
    if modifiers:
        return None
    values = [o.value(op, kind) for op in ops[1:]]
    bits = [o.value(op, plain) for op in ops[1:]]
    if name in ("add", "sub", "and", "or", "xor"):
        return o.assign(ops[0], f"({plain})({bits[0]} {_SIGNS[name]} {bits[1]})", kind)
    simple = {
        "neg": f"({plain})(0 - {bits[0]})",
        "not": f"({plain})~{bits[0]}",
        "abs": f"{values[0]} < 0 ? 0 - {bits[0]} : {bits[0]}",
    }
    if name in simple:
        return o.assign(ops[0], simple[name], plain)
    if name in ("min", "max"):
        sign = "<" if name == "min" else ">"
        return o.assign(ops[0], f"{values[0]} {sign} {values[1]} ? {values[0]} : {values[1]}", kind)
    if name in ("div", "rem"):
        call = "quotient" if name == "div" else "remainder"
        return o.assign(ops[0], f"{call}<{kind}>({values[0]}, {values[1]})", kind)
    return None


def _product(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    name, how, kind = opcode[0], opcode[1], opcode[-1]
    if len(opcode) != 3:
        return None
    width = bits_of(kind)
    plain, a, b = unsigned(width), o.value(ops[1], kind), o.value(ops[2], kind)
    if how == "wide":
        result = f"{kind[0]}{2 * width}"
        value = f"({result})({a}) * ({result})({b})"
    elif how == "lo":
        result = kind
        # Numbers of 16 bits would otherwise be multiplied as signed ones of 32.
        value = f"({plain})((u64)({plain})({a}) * (u64)({plain})({b}))"
    elif how == "hi":
        result, value = kind, f"mul_hi({a}, {b})"
    else:
        return None
    if name == "mad":
        sum_kind = unsigned(bits_of(result))
        value = f"({sum_kind})(({sum_kind})({value}) + {o.value(ops[3], sum_kind)})"
    return o.assign(ops[0], value, result)


def _bits(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    name, kind, modifiers = opcode[0], opcode[-1], opcode[1:-1]
    if kind == "pred" or kind[0] == "f":
        return None
    plain = unsigned(bits_of(kind))
    value = o.value(ops[1], kind if name in ("shr", "bfind") and kind[0] == "s" else plain)
    if name == "bfi" and not modifiers:
        into, place, count = o.value(ops[2], plain), *(o.value(op, "u32") for op in ops[3:])
        return o.assign(ops[0], f"bfi({value}, {into}, {place}, {count})", kind)
    numbers = [o.value(op, "u32") for op in ops[2:]]
    if name == "shf" and len(modifiers) == 2:
        low, high, count = o.value(ops[1], "u32"), *numbers[:2]
        count = f"at_most_32({count})" if modifiers[1] == "clamp" else f"({count} & 31)"
        return o.assign(ops[0], f"shf_{modifiers[0]}({low}, {high}, {count})", "b32")
    if name == "bfind":
        call = "bfind_shift" if modifiers == ("shiftamt",) else None if modifiers else "bfind"
        return None if call is None else o.assign(ops[0], f"{call}({value})", "u32")
    if modifiers:
        return None
    if name in ("shl", "shr"):
        return o.assign(ops[0], f"{name}({value}, {numbers[0]})", kind)
    if name in ("brev", "clz", "popc"):
        return o.assign(ops[0], f"{name}({value})", kind if name == "brev" else "u32")
    return None


def _branch(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    return f"goto {name_of(ops[0])};"


def _call(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    results = members(ops[0]) if ops[0].startswith("(") else []
    name, *arguments = ops[1:] if ops[0].startswith("(") else ops
    if name not in o.functions or len(arguments) > 1 or len(results) > 1:
        return None
    addresses = [f"(char*){o.value(argument, 'u64')}" for argument in (members(arguments[0]) if arguments else [])]
    result = f"(char*){o.value(results[0], 'u64')}" if results else "nullptr"
    declared = f"char* const given[] = {{{', '.join([*addresses, 'nullptr'])}}};"
    return f"{declared} {name_of(name)}_called({result}, given, shared, tid_x, ntid_x, ctaid_x, nctaid_x);"


def _together(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    """Stop the thread until others have come, see `lanes.h`."""
    kind = _TOGETHER.get(".".join(opcode))
    if kind is None or o.stops is None:
        return None
    o.stops += 1
    stop = [f"lane.at = {o.stops}; lane.kind = {kind};"]
    if kind != "ACTIVE_MASK":
        stop.append(f"lane.mask = {o.value(ops[-1], 'u32')};")
    if len(ops) == 3:
        stop.append(f"lane.value = {o.value(ops[1], 'pred')};")
    answer = o.assign(ops[0], "lane.result", "u32") if kind != "BARRIER" else ""
    return " ".join([*stop, f"return; stop_{o.stops}:;", answer])


def _end(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    return "return;"


def _nothing(o: Operands, opcode: tuple[str, ...], ops: tuple[str, ...]) -> str | None:
    """Order memory: of threads that run one after another, there is nothing to do."""
    return ";"


_FAMILIES: dict[str, Callable[[Operands, tuple[str, ...], tuple[str, ...]], str | None]] = {
    "mov": _move,
    "ld": _load,
    "st": _store,
    "cvta": _convert_address,
    "atom": _atomic,
    "setp": _compare,
    "selp": _select,
    "cvt": _convert,
    "bra": _branch,
    "call": _call,
    "ret": _end,
    **dict.fromkeys(TOGETHER, _together),
    **dict.fromkeys(("membar", "fence"), _nothing),
    **dict.fromkeys(("shl", "shr", "shf", "brev", "clz", "popc", "bfind", "bfi"), _bits),
    **dict.fromkeys(("add", "sub", "mul", "mad", "fma", "div", "rem", "neg", "abs", "min", "max"), _arithmetic),
    **dict.fromkeys(("and", "or", "xor", "not"), _arithmetic),
    **dict.fromkeys(("rcp", "sqrt", "rsqrt", "copysign", *_APPROXIMATE), _arithmetic),
}
