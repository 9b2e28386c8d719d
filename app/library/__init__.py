"""Every scan a folder that can be listed, named, kept, thrown away and carried to another machine."""
