"""The commands: what is asked, how it is run, what is printed and with which exit status."""
