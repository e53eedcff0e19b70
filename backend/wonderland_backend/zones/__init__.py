"""Zones (geo-awareness): data sets of ED-318 and ED-269, where and when each zone holds, what follows for a pad."""
