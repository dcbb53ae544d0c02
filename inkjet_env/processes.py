"""Processes that do not outlive the one that started them."""

import os
import threading
import time

LOOK_S = 0.5
"""Seconds between two looks of a process at whether its parent is still there."""


def end_with_parent(parent: int) -> None:
    """Let this process end soon after its parent, however that ended.

    Parameters
    ----------
    parent : int
        Process id of the parent. It is given, not asked for, as the parent may have ended already.
    """

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(LOOK_S)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
