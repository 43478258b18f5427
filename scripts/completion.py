"""Completions of the last word of a call of helix_arm, as its --help says. Run as a file by bash's completion.

usage: completion.py helix_arm [WORD...]

Words as bash splits them: `=` is a word of its own. Prints the pattern of files that may stand there too (`*`, `*.yaml`, or an
empty line for none), then one completion per line. Needs nothing but Python.
"""
import re
import subprocess
import sys

INDENT = " " * 28  # of a description in the help
FILE_TYPES = re.compile("FILE|DIR|PATH|SCENE|TEXT")  # TEXT is of options that name no type


def output_of(*command):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, check=False).stdout.decode().split("\n")


class Option:
    """An entry of the help: `-n,--name{default} TYPE:{words} ... REQUIRED  description`."""

    def __init__(self, program, left, description):
        self._program, self._description = program, description
        names, _, self._type = left.strip().partition(" ")
        self.names = re.sub(r"\{.*", "", names).split(",")
        self.words = re.split("[{},]", self._type)[1:-1] if "{" in self._type else []
        self.is_flag = not self._type or "{" in names
        self.is_required = "REQUIRED" in self._type
        self.takes_many = "..." in self._type and "repeatable" not in description

    def _named(self, what):
        return list(filter(None, output_of(self._program, "--names", what)))

    def values(self, word):
        """Pattern of files, and words."""
        text = self._description
        if "name of a shipped scene" in text:
            return "*.yaml", self._named("config/scenes")
        if "a shipped profile" in text:
            return "", text.split(", a shipped")[0].split(", ") + self._named("config/regulators")
        if "by OpenCV's name" in text:
            return "", self._named("dictionaries")
        if "comma list of" in text:
            before = word[:word.rfind(",") + 1]
            words = re.sub(r" \([^)]*\)", "", text.split("comma list of ")[1].split(";")[0]).split(", ")
            return "", [before + each for each in words]
        return "*" if not self.words and FILE_TYPES.search(self._type.split(":")[0]) else "", self.words


class Help:
    """The help of a command: its positionals, options and subcommands."""

    def __init__(self, *command):
        sections, section = {"Positionals:": [], "Options:": [], "Subcommands:": []}, []
        lines = output_of(*command, "--help")
        for line, after in zip(lines, lines[1:]):
            if not line.startswith("  "):
                section = sections.get(line, [])
            elif not line.startswith(INDENT):
                alone = after.startswith(INDENT)  # too long for its description
                section.append(Option(command[0], line if alone else line[:28], after.strip() if alone else line[28:]))
        self.positionals, self.options = sections["Positionals:"], sections["Options:"]
        self.subcommands = [option.names[0] for option in sections["Subcommands:"]]


def is_option(word):
    return len(word) > 1 and word.startswith("-")


def joined_at_equals(words):
    """`--format = csv` becomes `--format=` and `csv`; `KEY = VALUE` becomes `KEY=VALUE`."""
    out, glue = [], False
    for i, word in enumerate(words):
        if word == "=" and out:
            glue = not is_option(out[-1])
            out[-1] += word
            if i + 1 == len(words) and not glue:
                out.append("")
        elif glue:
            out[-1] += word
            glue = False
        else:
            out.append(word)
    return out


class Position:
    """Goes through the words before the last one."""

    def __init__(self, program):
        self._command = [program]  # as far as it leads to its help
        self._helps = [Help(program)]  # of the command and its subcommands so far
        self._positionals = 0
        self._awaited, self._has_value = None, False  # the option that takes the next word, and whether it has one already
        self._flag = None  # the word before, which may have a value

    def step(self, word):
        if self._awaited and not (self._has_value and is_option(word)):
            self._has_value = True
            self._awaited = self._awaited if self._awaited.takes_many else None
            return
        self._awaited, self._has_value = None, False
        flag, self._flag = self._flag, None
        if flag and word in flag.words:
            return
        if is_option(word):
            option = self._find(word.rstrip("="))
            if option and (word.endswith("=") or not option.is_flag):  # behind an =, a flag has a value, too
                self._awaited = option
            else:
                self._flag = option
            return
        self._command.append(word)
        if word in self._helps[-1].subcommands:
            self._helps.append(Help(*self._command))
            self._positionals = 0
        else:
            self._positionals += 1

    def completions(self, word):
        if self._awaited and not (self._has_value and is_option(word)):
            return self._awaited.values(word)
        if word.startswith("-"):
            return "", sorted({name for each in self._helps for option in each.options for name in option.names
                               if name.startswith("--")})
        positional, files, words = self._next_positional(), "", self._helps[-1].subcommands
        if positional and (positional.is_required or not words):
            files, words = positional.values(word)
        return files, (self._flag.words if self._flag else []) + words

    def _find(self, name):
        return next((option for each in reversed(self._helps) for option in each.options if name in option.names), None)

    def _next_positional(self):
        every = self._helps[-1].positionals
        if self._positionals < len(every):
            return every[self._positionals]
        return every[-1] if every and every[-1].takes_many else None


def main(program, *words):
    words = joined_at_equals(words) or [""]
    position = Position(program)
    for word in words[:-1]:
        position.step(word)
    files, found = position.completions(words[-1])
    print(files, *(word for word in found if word.startswith(words[-1])), sep="\n")


if __name__ == "__main__":
    if sys.argv[1:] in (["-h"], ["--help"]):
        print(__doc__)
        sys.exit()
    main(*sys.argv[1:])
