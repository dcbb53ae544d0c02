"""Compiled code on disk never outlives the source that it was compiled from."""

import os

from inkjet_env.printhead import kernel_cache


def test_code_older_than_any_source_of_the_simulator_is_discarded(tmp_path):
    module, cache = tmp_path / "kernels.py", tmp_path / "__pycache__"
    module.write_text("")
    cache.mkdir()
    stale, fresh, other = (cache / name for name in ("kernels.f-1.nbi", "kernels.g-2.nbi", "others.f-1.nbi"))
    newest = os.stat(kernel_cache.__file__).st_mtime
    for index, age_s in ((stale, 1e9), (fresh, -1e9), (other, 1e9)):
        index.write_bytes(b"")
        os.utime(index, (newest - age_s, newest - age_s))
    kernel_cache.discard_stale_code(str(module), cache)
    assert sorted(cache.iterdir()) == [fresh, other]
