"""Where a stranger's code runs: a locked child process, and the wire to it."""
