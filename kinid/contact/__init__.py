"""From a log and its rig to what happens where tool and material meet."""
