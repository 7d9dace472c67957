"""The stages joined as operators, for tagged and unknown targets: process, snapshot, restore."""
