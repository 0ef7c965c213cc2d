"""§5.2, §5.3: genotype to network, encodings, operators on genotypes, controllers made by hand."""
