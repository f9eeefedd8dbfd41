"""MAROON's pickled frames: arrays of numbers come through as numpy wrote them, and nothing else
does anything."""

import io
import os
import pickle

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from handbench.bench.datasets.maroon_frame import read_dictionary
from handbench.support.errors import HandbenchError
from handbench.support.limits import PICKLE_BYTES
from tests.strategies import examples

HEADER = io.BytesIO()
np.lib.format.write_array_header_1_0(HEADER, {"descr": "|O", "fortran_order": False, "shape": ()})


def npy(path, pickled: bytes):
    """A numpy file of an object whose pickle is `pickled`."""
    path.write_bytes(HEADER.getvalue() + pickled)
    return path


@examples(40)
@given(
    st.sampled_from(["<c8", "<c16", ">c16", "<f4", "<f8", ">f8", "<i8", "<i4", "|u1", "|b1"]),
    st.lists(st.integers(0, 4), max_size=4),
    st.booleans(),
    st.sampled_from([3, 4]),
)
def test_arrays_come_through_as_numpy_wrote_them(
    tmp_path_factory, dtype, shape, by_column, protocol
):
    values = np.arange(int(np.prod(shape)), dtype="<f8").reshape(shape).astype(dtype)
    values = np.asfortranarray(values) if by_column else values
    content = {"scalar": values.dtype.type(1), "n": 3, "x": 0.5, "text": "ü", "none": None}
    whole = np.array(content | {"xr": values, "yes": True}, dtype=object)
    pickled = pickle.dumps(whole, protocol)  # numpy 1's, numpy 2's
    if protocol == 3:
        pickled = pickled.replace(b"cnumpy._core.multiarray\n", b"cnumpy.core.multiarray\n")
    read = read_dictionary(npy(tmp_path_factory.mktemp("npy") / "a.npy", pickled))
    np.testing.assert_array_equal(read.pop("xr"), values)
    assert read == content | {"yes": True}


class Runs:
    """Runs a command when unpickled by pickle itself."""

    def __init__(self, file):
        self.file = file

    def __reduce__(self):
        return os.system, (f"touch {self.file}",)


@pytest.mark.parametrize("wrap", [lambda bad: bad, lambda bad: {"xr": np.array([bad], object)}])
def test_code_is_never_run(tmp_path, wrap):
    np.save(tmp_path / "a.npy", np.array(wrap(Runs(tmp_path / "ran")), object), allow_pickle=True)
    with pytest.raises(HandbenchError, match=r"it uses (posix|nt)\.system") as caught:
        read_dictionary(tmp_path / "a.npy")
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "ran").exists()
    np.load(tmp_path / "a.npy", allow_pickle=True)
    assert (
        tmp_path / "ran"
    ).exists()  # the file does run it when read without care: the test can fail


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        ({"xr": np.array([None, 1], dtype=object)}, "an array of objects"),
        ({"xr": {"deeper": 1}}, "'xr' is dict"),
        ({"xr": np.array(["text"])}, "numbers of type 'U4'"),
        ({"xr": np.zeros(2, [("re", "f4"), ("im", "f4")])}, "numbers of type 'V8'"),
        ({1: 2}, "a key is of type int"),
        ((1,), "it is not a dictionary"),
    ],
)
def test_anything_but_numbers_is_refused(tmp_path, content, reason):
    outer = np.empty((), dtype=object)
    outer[()] = content
    np.save(tmp_path / "a.npy", outer, allow_pickle=True)
    with pytest.raises(HandbenchError, match=reason):
        read_dictionary(tmp_path / "a.npy")


def test_plain_arrays_and_huge_files_are_refused(tmp_path):
    file = tmp_path / "a.npy"
    np.save(file, np.zeros(3))
    with pytest.raises(HandbenchError, match="not a dictionary"):
        read_dictionary(file)
    with file.open("wb") as stream:
        stream.truncate(PICKLE_BYTES + 1)
    with pytest.raises(HandbenchError, match="at most 268435456"):
        read_dictionary(file)


def test_a_shape_that_the_bytes_do_not_fill_takes_no_memory(tmp_path):
    pickled = pickle.dumps(np.array({"xr": np.zeros(255)}, dtype=object), 4)
    count, many = (pickle.dumps(n, 4)[2:-1] for n in (255, 2**40))
    assert count in pickled
    with pytest.raises(HandbenchError, match="was not read"):
        read_dictionary(npy(tmp_path / "a.npy", pickled.replace(count, many, 1)))


@pytest.mark.parametrize(
    "bomb, reason",
    [
        # remembers a list under the number 2³² − 1, which costs the unpickler in C 64 GB and this
        # one nothing
        (b"\x80\x04]r\xff\xff\xff\xff.", "it is not a dictionary"),
        (b"\x80\x04\x8e" + b"\xff" * 7 + b"\x7f.", "was not read"),  # text of 2⁶³ bytes
        (
            b"\x80\x04cnumpy\nndarray\n(I1000000000000\ntR.",
            "it is not a dictionary",
        ),  # an array of 8 TB
        (b"\x80\x04cnumpy\ndtype\n}b.", "it changes a function"),
        (
            b"\x80\x04}N" + b"2\x86" * 60 + b"Ns.",
            "was not read .50.",
        ),  # a key of 2⁶⁰ parts, by DUP ...
        (
            b"\x80\x04}N" + b"q\x00h\x00\x86" * 60 + b"Ns.",
            "a key is of type tuple",
        ),  # ... and by memo
        (
            b"\x80\x04N" + b"q\x00h\x00\x86" * 60 + b"\x85cnumpy\ndtype\n\x94h\x010h\x00R.",
            "was not read",
        ),
        (b"\x80\x04cnumpy\ndtype\nN" + b"q\x00h\x00\x86" * 60 + b"\x85R.", "numbers of no type"),
        (b"\x80\x04\x8f(N" + b"q\x00h\x00\x86" * 60 + b"\x90.", "was not read .143."),  # into a set
        (
            b"\x80\x04N" + b"q\x00h\x00\x86" * 60 + b"NR.",
            "it calls something that is not a known function",
        ),  # whose text has 2⁶⁰ parts
        (b"\x80\x04" + b"]" * 20_000 + b".", "too many steps"),
        (b"\x80\x04\x82\x01.", "was not read"),  # an extension that somebody may have registered
    ],
)
def test_bombs_are_refused(tmp_path, bomb, reason):
    with pytest.raises(HandbenchError, match=reason):
        read_dictionary(npy(tmp_path / "a.npy", bomb))
