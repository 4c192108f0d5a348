"""Files with random damage, read by client and service: an error, never another end.

``python -m tests.client.mutated_files 20000`` reads that many; the tests read some hundred.
"""

from __future__ import annotations

import faulthandler
import io
import json
import random
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

import vibroimpact as vi
from tests.client import model_files
from vibroimpact_service.documents import decode, parse, stored_systems, upload
from vibroimpact_service.problems import ProblemError
from vibroimpact_service.settings import Settings
from vibroimpact_solvers.errors import ModelError

_WORDS = (b" ", b"\t", b"\r", b"\0", b"\n", b",", b"%", b"-", b"nan", b"1e999", b"0x10", b"D3",
          b"9" * 12, b"\xff\xfe", b"\xff" * 4, b"\xff\xff\xff\x7f", b"\0" * 4)  # fmt: skip
_ENDS = (b" ", b"\t", b"\r", b"\0", b"\n\n", b"\x1a", b"1 1 1", b"1 ", b"-")
MODEL = model_files.model(np.random.default_rng(0))


def mutated(content: bytes, rng: random.Random) -> bytes:
    """Return a content with one to eight changes."""
    data = bytearray(content)
    for _ in range(rng.choice([1, 1, 1, 2, 3, 8])):
        at, count = rng.randrange(len(data) + 1), rng.randrange(1, 9)
        match rng.randrange(8):
            case 0:
                data[at : at + 1] = bytes([rng.randrange(256)])
            case 1:
                data[at : at + 1] = bytes(
                    byte ^ 1 << rng.randrange(8) for byte in data[at : at + 1]
                )
            case 2:
                del data[at : at + count]
            case 3:
                data[at:at] = rng.randbytes(count)
            case 4:
                del data[at:]
            case 5:
                data[at:at] = data[max(0, at - 5 * count) : at]
            case 6:
                data[at : at + rng.choice([0, 0, 4])] = rng.choice(_WORDS)
            case _:
                data += rng.choice(_ENDS)
    return bytes(data)


class Reader:
    """Reads files of all formats, damaged by chance."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._whole = {form: model_files.write(folder / form, form, MODEL)
                       for form in model_files.FORMS}  # fmt: skip
        M, K = MODEL["M"], MODEL["K"]
        array = io.BytesIO()
        np.save(array, np.array([M, K]))
        market = model_files.market(M) + model_files.market(K, form="array")
        document = {"M": M.tolist(), "K": K.tolist(), "constraints": [{"dof": 0, "gap": 0.1}]}
        self._bodies = {
            upload.MATRIX_MARKET: market.encode(),
            upload.NPY: array.getvalue(),
            stored_systems.JSON: json.dumps(document).encode(),
        }
        self._settings = Settings(data=folder, max_dofs=1000)
        self.forms = (*model_files.FORMS, *self._bodies)

    def read(self, form: str, rng: random.Random) -> str:
        """Read a damaged file: read, or refused."""
        if form in self._bodies:
            return self._upload(form, mutated(self._bodies[form], rng))
        arguments, keywords = self._whole[form]
        path = arguments[0] if arguments else keywords["K"]
        damaged = self._folder / f"damaged{path.suffix}"
        damaged.write_bytes(mutated(path.read_bytes(), rng))
        others: dict[str, Any] = {} if arguments else {"M": keywords["M"]}
        try:
            if arguments:
                vi.read_model(damaged)
            else:
                vi.read_model(K=damaged, **others)
        except ValueError:
            return "refused"
        return "read"

    def _upload(self, media_type: str, body: bytes) -> str:
        try:
            if media_type == stored_systems.JSON:
                document = parse.document(stored_systems.SYSTEM, parse.json(body))
            else:
                document, _ = upload.system(media_type, body, self._settings)
            decode.system(document)
        except ModelError:
            return "refused"
        except ProblemError as problem:
            return "refused" if 400 <= problem.type.status < 500 else "failed"
        return "read"


def run(folder: Path, count: int, seed: int) -> Counter[tuple[str, str]]:
    """Read `count` damaged files; return how many of each format were read and refused."""
    reader, rng = Reader(folder), random.Random(seed)
    found = Counter[tuple[str, str]]()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a damaged name is not used
        for index in range(count):
            form = reader.forms[index % len(reader.forms)]
            found[form, reader.read(form, rng)] += 1
    return found


if __name__ == "__main__":
    faulthandler.enable()
    with tempfile.TemporaryDirectory() as temporary:
        for key, number in sorted(run(Path(temporary), int(sys.argv[1]), 1).items()):
            print(*key, number)
