"""The connection to a server. The Blender add-on also has `client` and `recording`, with its own messages."""
