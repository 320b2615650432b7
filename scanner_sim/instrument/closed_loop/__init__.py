"""The instrument that follows its targets: pattern by pattern, each aimed by what the last one saw."""
