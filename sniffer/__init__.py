"""Robot-servo bus analyzer."""
__version__ = "0.1.0"
