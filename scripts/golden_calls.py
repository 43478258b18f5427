"""The calls that golden records: those of calls.txt, and checks of documents with each of their values broken."""

import collections
import itertools
import re
import shlex

EDITS = ("-7", "nonsense", "{}")  # values that take the place of each one
VALUE = re.compile(r'([A-Za-z_]\w*): +(\[[^\]]*\]|\{[^{}]*\}|"[^"]*"|[^,}\s#"][^,}#]*)')


class Call:
    """One run of the command: its words, what it reads on stdin, files that stand in its folder, and where its output is kept."""

    def __init__(self, words, stdin=None, keep=None, files=None, note=""):
        self.words, self.stdin, self.keep, self.files, self.note = words, stdin, keep, files or {}, note and "  # " + note
        text = " ".join([note] if note else [*words, stdin or ""])
        self.name = re.sub(r"[^\w.,=+-]+", "_", text).strip("_-")[:150] or "no_arguments"


def expanded(text):
    """All texts that <a|b> stands for."""
    parts = re.split(r"<([^<>]*\|[^<>]*)>", text)
    choices = [part.split("|") if i % 2 else [part] for i, part in enumerate(parts)]
    return ["".join(choice) for choice in itertools.product(*choices)]


def read_calls(path):
    """(calls, files by name, names of documents to break) of a file such as calls.txt."""
    calls, files, documents, macros = [], {}, [], {}
    for line in path.read_text(encoding="utf-8").splitlines():
        if not line.strip() or line.startswith("#"):
            continue
        kind, _, rest = line.partition(" ")
        if kind == "file":
            name, _, text = rest.strip().partition(" ")
            files[name] = text.encode("latin-1").decode("unicode_escape").encode("latin-1")
        elif kind == "break":
            documents += rest.split()
        elif re.match(r"\$\w+ = ", line):
            macros[kind] = rest[2:]
        else:
            line = re.sub(r"\$\w+", lambda name: macros[name.group()], line)
            keep = re.match(r"keep (\w+): *(.*)", line)
            for text in expanded(keep.group(2) if keep else line):
                text, _, stdin = text.partition(" << ")
                calls.append(Call(shlex.split(text), stdin.strip() or None, keep and keep.group(1)))
    return calls, files, documents


def broken(text):
    """(note, text) with each value of a YAML document replaced by those of EDITS, its key misspelt, and its line left out. All
    without comments, which would shift the lines of messages; a note has the key with its number of occurrences so far."""
    lines = [line for line in re.sub(r"(?m)(^|\s)#.*", "", text).split("\n") if line.strip()]
    count = collections.Counter()
    for i, code in enumerate(lines):
        for found in VALUE.finditer(code):
            key, start, end = found.group(1), found.start(2), found.end(2)
            count[key] += 1
            edits = [(value, code[:start] + value + code[end:]) for value in EDITS]
            edits.append(("misspelt", code[:found.end(1)] + "x" + code[found.end(1):]))
            if re.fullmatch(r"\s*\w+: .*", code) and code.count(":") == 1:
                edits.append(("left out", ""))
            for what, edited in edits:
                yield "%s %d %s" % (key, count[key], what), "\n".join(lines[:i] + [edited] + lines[i + 1:])


def broken_calls(documents, package):
    """Checks of broken scenes, and of demo_serial or demo_modbus with a broken profile."""
    calls = []
    for name in documents:
        scene, profile = (package / "config" / folder / (name + ".yaml") for folder in ("scenes", "regulators"))
        document = (scene if scene.is_file() else profile).read_text(encoding="utf-8")
        user = package / "config/scenes" / ("demo_modbus.yaml" if "modbus_tcp:" in document else "demo_serial.yaml")
        user = re.sub(r"profile: \w+", "profile: ./profile.yaml", user.read_text(encoding="utf-8")).encode()
        for note, text in broken(document):
            files = {"scene.yaml": text.encode()} if scene.is_file() else {"scene.yaml": user, "profile.yaml": text.encode()}
            calls.append(Call(["check", "scene.yaml", "--samples", "0"], files=files, note="broken %s %s" % (name, note)))
    return calls


def unique_names(calls):
    """The calls by a name that no other has."""
    named = {}
    for call in calls:
        same = [call.name] + ["%s+%d" % (call.name, k) for k in range(2, 99)]
        named[next(name for name in same if name not in named)] = call
    return named
