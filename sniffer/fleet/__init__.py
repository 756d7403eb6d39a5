"""Many captures become one data set: the work on one of them, the engines that share it out."""
