"""Files of other isogeometric programs."""
