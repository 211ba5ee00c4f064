"""The tables of docs that derive from code: topics, parameters, packet, commands, summary keys."""
