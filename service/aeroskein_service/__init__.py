"""The networked shell around the fusion core: configuration, codec, Zenoh transport, commands."""
