"""What the live view and the player draw alike: surroundings and solids, and the modules of the page that draw them."""
