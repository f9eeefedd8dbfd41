"""Hard cases: what could blow up, what it is compared with, the bound with its reason, and the measured figure."""
