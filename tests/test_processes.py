"""What tests wait for in other processes."""

import threading

from tests.processes import wait_until, written_json


def test_a_file_that_is_being_written_is_waited_for(tmp_path):
    file, content = tmp_path / "scheduler.json", '{"address": "tcp://127.0.0.1:1"}'
    assert written_json(file) is None
    for whole in range(len(content)):
        file.write_text(content[:whole])
        assert written_json(file) is None
    threading.Timer(0.1, file.write_text, [content]).start()
    assert wait_until(lambda: written_json(file)) == {"address": "tcp://127.0.0.1:1"}
