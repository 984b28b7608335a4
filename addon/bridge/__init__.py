"""Between Blender's data and the backend's arrays: the only bulk readers and writers."""
