"""The card: CSI records in, the channel of each packet of a known robot out; pings on their way to the air.

Touches the card's source and its monitor interface (`csi_bridge` has the bytes); no neighbour, no pose.
"""
