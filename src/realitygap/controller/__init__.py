"""§5.2, §5.3: genotype to network, the operators that change a genotype, controllers made by hand."""
