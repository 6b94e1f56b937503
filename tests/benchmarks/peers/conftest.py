"""These are scripts of their own, for interpreters that have the peers: no tests."""

collect_ignore_glob = ["*.py"]
