"""Bridges to other tools, each imported only when it is named: state_space, stonesoup."""
