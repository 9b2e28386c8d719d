"""Work that takes time: run, watched, paused, cancelled and told about, whoever looks on."""
