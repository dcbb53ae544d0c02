"""Exit statuses of the command other than 0, which means done."""

CHECK_FAILED = 1
BAD_INPUT = 2
INTERRUPTED = 130
