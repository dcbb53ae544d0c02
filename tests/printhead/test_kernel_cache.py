"""Compiled code on disk never outlives the source that it was compiled from."""

import os
import subprocess
import sys

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


KERNELS = """
from inkjet_env.printhead.kernel_cache import kernel_jit

@kernel_jit(__file__)
def double(x):
    return 2 * x

print(double(21.0), double.stats.cache_hits[double.signatures[0]] if double.stats.cache_hits else 0)
"""


def runner(place):
    """Runs a module with one kernel in a process of its own; what it prints and says, and the folder of its code."""
    module, folder = place / "kernels.py", place / "cache"
    module.write_text(KERNELS)

    def run(**environment):
        given = {**os.environ, "NUMBA_CACHE_DIR": str(folder), **environment}
        done = subprocess.run([sys.executable, module], env=given, capture_output=True, text=True, timeout=300)
        return done.returncode, done.stdout.strip(), done.stderr

    return run, folder


def test_kept_code_is_used_and_damaged_code_is_compiled_again(tmp_path):
    run, folder = runner(tmp_path)
    assert run()[:2] == (0, "42.0 0")
    assert run()[:2] == (0, "42.0 1")
    for damage in (lambda b: b"", lambda b: b[: len(b) // 2], lambda b: b[:100] + b"\xff" * 50 + b[150:]):
        files = [*folder.rglob("*.nbi"), *folder.rglob("*.nbc")]
        assert len(files) == 2
        for file in files:
            file.write_bytes(damage(file.read_bytes()))
        assert run()[:2] == (0, "42.0 0")
    assert run()[:2] == (0, "42.0 1")  # what was compiled last is kept


def test_code_that_cannot_be_kept_is_compiled_and_told_of(tmp_path):
    run, folder = runner(tmp_path)
    failing = (
        "import numba.core.caching as c, errno, os\n"
        "def full(self, key, data): raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), 'x')\n"
        "c.IndexDataCacheFile.save = full\n"
    )
    module = folder.parent / "kernels.py"
    module.write_text(failing + KERNELS)
    status, printed, said = run()
    assert (status, printed) == (0, "42.0 0")
    assert "Compiled code cannot be kept, because x: No space left on device" in said
