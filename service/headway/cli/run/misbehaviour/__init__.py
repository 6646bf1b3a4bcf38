"""Events as misbehaviour reports of ETSI TS 103 759."""
