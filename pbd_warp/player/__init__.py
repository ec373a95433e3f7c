"""Motion that is done: one file that plays it in the browser, or a video of it. Nothing is simulated here."""
