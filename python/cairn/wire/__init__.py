"""What talks to a server. The Blender add-on has `client` and `recording`, too, with messages of its own making."""
