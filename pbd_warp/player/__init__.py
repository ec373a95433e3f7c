"""Motion that is done: recorded, played in the browser from one file, drawn as a video. No server, nothing simulated."""
