"""One file each: a `Sink` (sink.py), found by the scheme of its URI (uri.py)."""
