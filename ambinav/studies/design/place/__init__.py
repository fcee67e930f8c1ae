"""Where to put posts, panels or tags, so that bad floor shrinks most."""
