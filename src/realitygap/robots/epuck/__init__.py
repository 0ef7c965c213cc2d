"""An e-puck on its serial line, an e-puck2 over WiFi too."""
