"""How the shipped scenes are modelled: solids, sheets, fittings and the two modules."""
