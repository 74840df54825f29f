"""Properties over a surface: from probes to maps, to what to touch next, and to other programs."""
