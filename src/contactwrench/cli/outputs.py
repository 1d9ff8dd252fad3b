"""What a verb writes, held against what it reads and against what is there, before anything is read.

Every argument that is no output counts as read where it names something, so that a new option is guarded by itself.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextvars import copy_context
from dataclasses import dataclass
from functools import wraps
from inspect import Parameter
from pathlib import Path
from typing import Any, Final, TypeAlias, get_args

from ..errors import FileAccessError, InputError, of_extra
from ..files import KEPT, STDOUT, already_there, cause_named, identity, parts_of, target_of
from ..recording.bags.folder import METADATA
from ..recording.bags.open import SUFFIXES_OF_BAGS
from ..recording.tables.hdf5 import SUFFIXES as SUFFIXES_OF_HDF5
from ..recording.tables.parquet import SUFFIXES as SUFFIXES_OF_PARQUET
from . import options

Key: TypeAlias = tuple[int, int] | str
"""What `identity` says."""
STDIN = "/dev/stdin"
NAMES_FOLDER: Final = "names a folder"
"""In the annotation of a text: it may name a folder that is read, too. A path may always."""
OF_PAGE = b"<footer>contactwrench "
"""At the end of the pages that the program writes."""
OF_KINDS = (*SUFFIXES_OF_BAGS, *SUFFIXES_OF_PARQUET, *SUFFIXES_OF_HDF5, ".csv", ".tsv", ".json", ".html")
KINDS = (*SUFFIXES_OF_BAGS, *SUFFIXES_OF_PARQUET, ".zstd")


@dataclass(frozen=True)
class Writes:
    """In the annotation of a path: it is written, or the `files` that follow from it and the values of all arguments. A
    `page` is made anew over one of this program's, as nobody's work is in that; another file that is there and not
    empty is replaced only with --force. A suffix of another kind of file than `suffix`, a page's .html, is refused.
    """

    files: Callable[[Path, Mapping[str, Any]], Iterable[Path]] = lambda path, _: [path]
    page: bool = False
    suffix: str = ""


def output_option(metavar: str, help: str, default: Any = None, **of: Any) -> Any:
    """The declaration of --output, a path that is written: `of` it as of `Writes`."""
    return options.text(metavar, help, "--output", "-o", default=default, mark=Writes(**of))


def guarded(verb: Callable[..., Any]) -> Callable[..., Any]:
    """A verb that writes over nothing that it reads, and over what is there only with --force: an option that it gets
    here, unless it has a `force` of its own.
    """
    own = options.parameters_of(verb)
    marks = {name: get_args(each.annotation)[1:] for name, each in own.items()}
    outputs = {name: mark for name, every in marks.items() for mark in every if isinstance(mark, Writes)}
    if not outputs:
        return options.spelled(verb, own.values())
    force = Parameter("force", Parameter.KEYWORD_ONLY, default=options.FORCE, annotation=bool)

    @wraps(verb)
    def run(**values: Any) -> Any:
        read = {
            key: text
            for name in own
            if name not in outputs
            for value in (values[name] if isinstance(values[name], list) else [values[name]])
            for key, text in _read(value, or_folder=isinstance(value, Path) or NAMES_FOLDER in marks[name])
        }
        _require_one_on_stdout(outputs, values)
        within = copy_context()
        within.run(KEPT.set, _to_be_kept(outputs, values, read))
        for name, mark in outputs.items():
            _require_suffix(mark, mark.files(values[name], values) if values[name] is not None else ())
        return within.run(verb, **{name: values[name] for name in own})

    return options.spelled(run, {**own, "force": own.get("force", force)}.values())


def _require_one_on_stdout(outputs: Mapping[str, Writes], values: Mapping[str, Any]) -> None:
    """Raise `InputError` for a page on stdout beside anything else: nobody could tell where one of them ends."""
    there = [name for name in outputs if str(values[name]) == STDOUT]
    page = next((f"--{name} -" for name in there if outputs[name].page), None)
    others = [f"--{name} -" for name in there if not outputs[name].page] + ["--json"] * bool(values.get("json"))
    if page and others:
        raise InputError(
            f"found {' and '.join([*others, page])}, expected one output on standard output: name a file for the others"
        )


def _to_be_kept(outputs: Mapping[str, Writes], values: Mapping[str, Any], read: Mapping[Key, str]) -> set[Path]:
    """The places at which a file that appears until the end is to be kept, too. Raises `FileAccessError` for an output
    that is read, for two that are one file, for a file that is there, and for a folder that is not there or cannot be
    written; `MissingExtraError` for a page that nothing can draw: of several outputs none is left without the others.
    """
    written, kept = set[Key](), set[Path]()
    for name, mark in outputs.items():
        if mark.page and values[name] is not None:
            of_extra("matplotlib", "the report", "report")
        named = values[name] is not None and str(values[name]) != STDOUT
        for file in mark.files(values[name], values) if named else ():
            _require_unread(file, read)
            target = target_of(file)
            if file == values[name] and not any(map(os.path.isdir, read.values())):
                # a Path has lost it
                slashed = (a.rpartition("=")[2] for a in sys.argv[1:] if a.endswith("/"))
                if text := next((text for text in slashed if Path(text) == file), None):
                    raise FileAccessError(f"{text}: found a folder's name, expected a file's: leave out its last /")
            if target.exists() and not target.is_file():
                continue
            _require_place(file, target.parent, made=file.parent == values[name])
            if identity(target) in written:
                raise FileAccessError(f"{file}: found two outputs in one file, expected one each: name another")
            written.add(identity(target))
            if not values["force"] and not (mark.page and target.is_file() and OF_PAGE in target.read_bytes()[-200:]):
                if target.exists() and target.stat().st_size:
                    raise already_there(file)
                kept |= set() if target.exists() else {target}
    return kept


def _require_suffix(mark: Writes, files: Iterable[Path]) -> None:
    """Raise `InputError` for a name that is one of another kind of file; any will do where none is expected."""
    expected = ".html" if mark.page else mark.suffix
    for file in files:
        if expected and (suffix := file.suffix.lower()) != expected and suffix in OF_KINDS:
            raise InputError(f"{file}: found the suffix {suffix}, expected {expected}: name it so")


def _require_place(file: Path, folder: Path, *, made: bool) -> None:
    """Raise `FileAccessError` unless a file can be made in a folder, or, where that is to be `made`, in one above."""
    while made and not os.path.lexists(folder):
        file, folder = folder, folder.parent
    with cause_named(file), tempfile.TemporaryFile(dir=folder):
        pass


def _read(value: object, *, or_folder: bool) -> Iterator[tuple[Key, str]]:
    """The files and folders that an argument names, if any, each with the name that was given: the text, or what stands
    in it before a colon, as in arm.urdf:LINK.
    """
    given = str(value) if isinstance(value, str | Path) else ""
    for text in [given, *(given[:k] for k, letter in enumerate(given) if letter == ":")]:
        if os.path.isfile(STDIN if text == STDOUT else text):
            yield identity(STDIN if text == STDOUT else text), text
            file = Path(os.path.realpath(text))
            if _is_part(file):  # what sqlite3 keeps beside it, and what ROS 2 says of it, there or not
                for name in (METADATA, *(f"{file.name}-{kind}" for kind in ("wal", "shm", "journal"))):
                    yield identity(file.with_name(name)), text
        elif or_folder and text and os.path.isdir(text):
            for path in [text, *(path for path in parts_of(text) if os.path.isdir(path) or _is_part(Path(path)))]:
                yield identity(path), text


def _require_unread(file: Path, read: Mapping[Key, str]) -> None:
    """Raise `FileAccessError` for a file that is read, or would be the next time, as a part of a folder."""
    target, when = Path(os.path.realpath(file)), "is"
    name = read.get(identity(target))
    if name is None and _is_part(target):
        when, name = "would be", next(filter(None, map(read.get, map(identity, target.parents))), None)
    if name is not None:
        raise FileAccessError(f"{file}: found what {when} read as {name}, expected another file to write: name one")


def _is_part(path: Path) -> bool:
    """Whether a file in a folder is read, or would be, as part of the recording that the folder is."""
    return path.suffix.lower().startswith(KINDS) or path.name == METADATA or path.parent.name == "meta"
