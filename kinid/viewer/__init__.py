"""Maps, logs and campaigns in the browser of this machine."""
