"""The scenes that come with the project. Every file here is one: a docstring that says what one should see, and a
function `scene()` that returns a `pbd_warp.Scene`."""
