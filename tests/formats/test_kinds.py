"""Kinds of files that were once misread, refused for a wrong reason or passed over: each file made
here, its relatives, and the public case that it stands for are read as its kind says.
"""

import joint_kinds
import other_kinds
import pytest
from kinds import CASES
from written_logs import seen

KINDS = [*joint_kinds.KINDS, *other_kinds.KINDS]


def require_words(kind, folder):
    said = seen(folder / kind.place if kind.place else folder)
    assert [words for words in kind.says if words not in said] == [], said
    assert [words for words in kind.never if words in said] == [], said
    assert ("! " in said) == kind.stops, said


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: f"{kind.number}-{kind.says[0][:30]}")
def test_a_made_file_is_read_as_its_kind_says(tmp_path, kind):
    kind.make(tmp_path)
    require_words(kind, tmp_path)


PUBLIC = [kind for kind in KINDS if kind.public]


@pytest.mark.parametrize("kind", PUBLIC, ids=lambda kind: kind.number)
def test_a_public_case_is_read_as_its_kind_says(kind):
    folder = next(iter(CASES.glob(f"{kind.number}-*")), None)
    if folder is None:
        pytest.skip(f"../shared/cases is absent at {CASES}: it lies beside the project")
    require_words(kind, folder)
