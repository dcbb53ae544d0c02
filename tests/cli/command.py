"""The command as it is run, and the files that it leaves."""

import pytest

from inkjet_env.cli.app import main


def run(*arguments):
    """Exit status of the command."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return ended.value.code


def files_below(folder):
    return sorted(str(path.relative_to(folder)) for path in folder.rglob("*"))
